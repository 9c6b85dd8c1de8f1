"""The commands: what each does from a case file to what it prints and writes, for the command line and the workflow."""
