"""The tests: a package, as a library that they use installs one of this name too."""
