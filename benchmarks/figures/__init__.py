"""The numbers and tables of the documentation: measured, and kept with commit, machine and date."""
