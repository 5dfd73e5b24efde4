"""Linear analysis of a model: state spaces, loops, modes, what limits the bandwidth."""
