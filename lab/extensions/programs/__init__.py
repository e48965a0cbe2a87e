"""Languages of robot controllers: programs are written and read, one module a language."""
