// The whole part in C++ as one unit: the headers of DART and gz-physics take most of the compiler's time.

#include "load.cc"
#include "motion.cc"
#include "contact.cc"
#include "friction.cc"
