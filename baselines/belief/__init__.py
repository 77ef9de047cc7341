"""Beliefs about the source: particles and grids, their likelihoods, resampling, Gaussian fits and information."""
