/* Guard conditions: whoever triggers one gives work to the thread that waits for it, such as a timer
 * whose simulated time has come, or a message that is handed over within the process. From the trigger
 * on that is a callback of the process that began, until the guard that woke a thread is waited for again.
 * What nobody waits for is no work. */
#pragma once
#include <stdbool.h>

#include "slices.h"

struct place;

/* How rmw_guard_condition_t begins: what is waited for is its data. */
struct guard_head {
  const char *implementation;
  void *data;
};

/* More in one wait set are no work. */
#define GUARDS 128u

/* What a wait is for, as its sets have it no more when it has ended. */
struct awaited {
  size_t count;
  struct place *places[GUARDS];
};

/* A wait for these begins: what woke the last one has been handled. */
void guards_wait(const struct set *guards, struct awaited *awaited);
/* It has ended; where something is `ready`, those that are not are NULL. */
void guards_woken(const struct set *guards, const struct awaited *awaited, bool ready);
/* Somebody is about to trigger it. */
void guard_triggered(const struct guard_head *guard);
/* It is about to be destroyed. */
void guard_destroyed(const struct guard_head *guard);
/* A child has none of its parent's. */
void guards_forget(void);
