"""A first guess of the missing effect, from one fit."""
