/* What all C files of the core share.

   Ownership: every array belongs to the Python side and outlives the call; the core keeps no
   pointer, allocates nothing, takes no lock and never calls Python. Entries check nothing: each is
   called by its Python twin alone, which has checked types, sizes and strides. Sizes are int64_t;
   arrays are contiguous, the last axis running fastest, unless a stride is given. Complex numbers
   are pairs of double: real, imaginary. */
#ifndef STRUCK_CORE_H
#define STRUCK_CORE_H

#include <stdint.h>

#if defined(_WIN32)
#define ENTRY __declspec(dllexport)
#else
#define ENTRY __attribute__((visibility("default")))
#endif

/* Loops over modes, taps or places are what the compiler turns into vectors. */
#if defined(SCALAR) /* but where few bytes count for more */
#define VECTORS
#else
#define VECTORS _Pragma("clang loop vectorize(enable) interleave(enable)")
#endif

static inline double larger(double a, double b) { return a > b ? a : b; }
static inline double smaller(double a, double b) { return a < b ? a : b; }
static inline int64_t least(int64_t a, int64_t b) { return a < b ? a : b; }
static inline int64_t most(int64_t a, int64_t b) { return a > b ? a : b; }

#endif
