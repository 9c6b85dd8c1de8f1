"""What the recorded motions can show at all: which parameters and effects they cannot see or tell apart, in words, and
which motion would."""
