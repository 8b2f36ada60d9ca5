"""MJX: MuJoCo written in JAX, told by MuJoCo's own files."""
