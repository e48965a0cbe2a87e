"""One campaign as one readable function, and the options it takes."""
