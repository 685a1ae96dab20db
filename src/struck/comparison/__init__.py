"""A model beside another, or beside a recording."""
