"""MuJoCo Warp: MuJoCo written for graphics processors, in single precision, told by MuJoCo's own files."""
