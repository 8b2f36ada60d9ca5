"""MuJoCo Warp: MuJoCo written for graphics processors, in single precision, given MuJoCo's files."""
