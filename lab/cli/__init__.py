"""The command line: arguments in, a call of the library, its result out."""
