"""Serve the bench in the browser: a server at a loopback address, and processes that compute.

The server itself imports no JAX, so that the page answers while others compute.
"""
