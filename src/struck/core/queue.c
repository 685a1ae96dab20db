/* The two ends of a queue of records (queue.h): how many wait, and the moves of its counts. */
#include "queue.h"

/* How many records are written and not yet released. */
ENTRY int64_t queue_waiting(const int64_t *memory) {
  return acquire(memory + WRITTEN) - acquire(memory + TAKEN);
}

/* Give the slot of the oldest record back to the writer. */
ENTRY void queue_release(int64_t *memory) { release(memory + TAKEN, memory[TAKEN] + 1); }

/* Hand the slot that was just written to the reader. */
ENTRY void queue_publish(int64_t *memory) { release(memory + WRITTEN, memory[WRITTEN] + 1); }
