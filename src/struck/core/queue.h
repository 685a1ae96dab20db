/* A queue of fixed-size records between one writer and one reader, without a lock.

   memory: HEAD numbers, then the integers of all slots, then their reals (as the bits of int64). The
   writer fills the next slot and then moves WRITTEN (release); the reader sees it move (acquire),
   reads the slot in place and then moves READ. Each count has one owner and only grows (L. Lamport,
   "Specifying concurrent program modules", ACM TOPLAS 5(2), 1983). What different threads write is
   128 bytes apart: the pair of cache lines that a processor fetches together. */
#ifndef STRUCK_QUEUE_H
#define STRUCK_QUEUE_H

#include "core.h"

enum queue_place { CAPACITY = 0, INTEGERS = 1, REALS = 2, WRITTEN = 16, TAKEN = 32, HEAD = 48 };

/* Nothing after it is read before it; nothing before it is written after it (C11, 7.17.3). */
static inline int64_t acquire(const int64_t *place) {
  return __atomic_load_n(place, __ATOMIC_ACQUIRE);
}
static inline void release(int64_t *place, int64_t value) {
  __atomic_store_n(place, value, __ATOMIC_RELEASE);
}

static inline const int64_t *integers_of(const int64_t *memory, int64_t count) {
  return memory + HEAD + count % memory[CAPACITY] * memory[INTEGERS];
}
static inline const double *reals_of(const int64_t *memory, int64_t count) {
  const int64_t first = HEAD + memory[CAPACITY] * memory[INTEGERS];
  return (const double *)(memory + first + count % memory[CAPACITY] * memory[REALS]);
}

ENTRY int64_t queue_waiting(const int64_t *memory);
ENTRY void queue_release(int64_t *memory);

#endif
