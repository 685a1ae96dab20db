"""The fit of 2007 as its paper has it."""
