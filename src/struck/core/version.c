/* Which sources a library was compiled from, and what the processor can do. */
#include "core.h"

#if defined(__x86_64__)
#include <cpuid.h>
#endif

/* Number of the sources that this library was compiled from. */
ENTRY int64_t core_fingerprint(void) { return FINGERPRINT; }

#if defined(__x86_64__)
static uint64_t saved_by_the_system(void) {
  uint32_t low, high;
  __asm__ volatile("xgetbv" : "=a"(low), "=d"(high) : "c"(0));
  return (uint64_t)high << 32 | low;
}
#endif

/* Highest level of x86-64 that processor and system have: 1 to 4 (psABI 1.0); 0 elsewhere. */
ENTRY int64_t core_level(void) {
#if defined(__x86_64__)
  uint32_t a, b, c, d, b7, c7, d7;
  if (!__get_cpuid(1, &a, &b, &c, &d)) return 1;
  const uint32_t second = bit_SSE3 | bit_SSSE3 | bit_SSE4_1 | bit_SSE4_2 | bit_POPCNT | bit_CMPXCHG16B;
  if ((c & second) != second) return 1;
  const uint32_t third = bit_FMA | bit_MOVBE | bit_AVX | bit_F16C | bit_OSXSAVE;
  if ((c & third) != third || (saved_by_the_system() & 6) != 6) return 2;
  if (!__get_cpuid_count(7, 0, &a, &b7, &c7, &d7)) return 2;
  const uint32_t wide = bit_AVX2 | bit_BMI | bit_BMI2;
  if ((b7 & wide) != wide) return 2;
  /* Where it is missing, the instruction silently does something else. */
  if (!__get_cpuid(0x80000001, &a, &b, &c, &d) || !(c & bit_LZCNT)) return 2;
  const uint32_t fourth = bit_AVX512F | bit_AVX512BW | bit_AVX512CD | bit_AVX512DQ | bit_AVX512VL;
  if ((b7 & fourth) != fourth || (saved_by_the_system() & 0xe6) != 0xe6) return 3;
  return 4;
#else
  return 0;
#endif
}
