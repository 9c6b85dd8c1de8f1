"""What may be said: which effects count as certain, possible or small, and the sentences of the verdict."""
