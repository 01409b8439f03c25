"""Serve the bench in the browser: a server at a loopback address, and processes that compute.

The server never imports JAX, so that the page answers while others compute; `serve` starts it.
"""
