/* What the core can do at most: fused multiply-adds of doubles, cycles; and blocks without Python.

   Chains of multiply-adds that do not wait for each other stay in registers: as many as there are,
   but for two constants. */
#include <stdint.h>

#if defined(__AVX512F__)
enum { WIDTH = 8, CHAINS = 24 };
#elif defined(__x86_64__)
enum { WIDTH = 4, CHAINS = 12 };
#else
enum { WIDTH = 2, CHAINS = 24 };
#endif
typedef double vector __attribute__((vector_size(8 * WIDTH)));
enum { UNROLLED = 4 };

int64_t multiply_adds_a_turn(void) { return UNROLLED * CHAINS * WIDTH; }
int64_t width(void) { return WIDTH; }

double multiply_adds(int64_t turns) {
  vector chains[CHAINS], factor = {0}, addend = {0};
  factor += 0.999;
  addend += 0.01;
#pragma clang loop unroll(full)
  for (int c = 0; c < CHAINS; c++) chains[c] = addend * (double)c;
  for (int64_t turn = 0; turn < turns; turn++)
#pragma clang loop unroll(full)
    for (int u = 0; u < UNROLLED; u++)
#pragma clang loop unroll(full)
      for (int c = 0; c < CHAINS; c++) chains[c] = chains[c] * factor + addend;
  vector total = chains[0];
#pragma clang loop unroll(full)
  for (int c = 1; c < CHAINS; c++) total += chains[c];
  return total[0];
}

/* Products of three cycles each that wait for each other, eight a turn. */
uint64_t wait_for(int64_t turns) {
  uint64_t value = 3;
  for (int64_t turn = 0; turn < turns; turn++)
    for (int n = 0; n < 8; n++) value *= value;
  return value;
}

/* Blocks of a bank, one after the other. */
void blocks(void (*make)(double *, int64_t *), double *reals, int64_t *wholes, int64_t count) {
  for (int64_t n = 0; n < count; n++) make(reals, wholes);
}
