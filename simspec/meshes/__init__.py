"""Files of triangles: read in a process of their own, made into convex hulls, remembered."""
