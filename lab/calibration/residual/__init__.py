"""What no effect explains: a Gaussian process of the joints' positions, with its uncertainty."""
