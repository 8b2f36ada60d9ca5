"""MJX: MuJoCo written in JAX, given MuJoCo's files."""
