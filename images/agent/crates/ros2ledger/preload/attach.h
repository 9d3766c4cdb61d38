/* This process' place in the ledger. */
#pragma once
#include <pthread.h>
#include <stdbool.h>
#include <stdint.h>

#include "layout.h"

#define NO_PROCESS UINT32_MAX
#define INNER __attribute__((visibility("hidden")))

/* Held by whoever creates, links and destroys. */
extern INNER pthread_mutex_t attach_lock;
extern INNER struct ledger *_Atomic attach_ledger; /* mapped once, kept until the process ends */
extern INNER _Atomic uint32_t attach_entry;        /* in the table of processes */

/* Remembers where the ledger is. `in_child` is called in each child of a fork, and calls
 * attach_child. */
void attach_begin(void (*in_child)(void));
/* A child has its parent's memory and must not count for it: it asks for a place of its own. */
void attach_child(void);
/* Under the lock: whether this process may count. Before it counts for the first time, `begin` is
 * called. */
bool attach(void (*begin)(void));
/* Wakes who waits for such an event, once for each time that somebody asks for it. The figure that
 * changed was written before: whoever asks later finds it. */
void changed(struct ledger *ledger, enum ledger_event event);

/* The ledger and this process' entry in it; NULL while it does not count. */
static inline struct ledger *attached(uint32_t *entry) {
  *entry = atomic_load_explicit(&attach_entry, memory_order_acquire);
  return *entry == NO_PROCESS ? NULL : atomic_load_explicit(&attach_ledger, memory_order_relaxed);
}
