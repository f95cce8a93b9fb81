"""Commands, one in each file; the command line finds them here."""
