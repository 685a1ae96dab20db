"""The one model that all doors make: modes, gains over contact and listener, material."""
