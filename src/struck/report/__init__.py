"""Pictures and pages for people: charts, reports of fits and models, the gallery."""
