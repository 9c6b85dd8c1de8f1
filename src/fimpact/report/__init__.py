"""The report of a diagnosis: one page with its pictures and its film."""
