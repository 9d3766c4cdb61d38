/* Counts what a process takes, calls and publishes. Without a ledger every function does nothing.
 * No function fails or changes errno. None takes a lock, so that a signal may interrupt it, but a
 * thread's first take, which asks the C library for a call at the thread's end. */
#pragma once
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "layout.h"
#include "origin.h"

/* CLOCK_MONOTONIC in nanoseconds while somebody watches; 0 while nobody does. */
uint64_t count_moment(void);
/* A take that was begun at that moment, of messages that all come from there. */
void count_take(const void *subscription, uint64_t messages, uint64_t begun, struct origin origin);
/* What a wait that was begun at that moment was given for a subscription, which had nothing to take. */
void count_rest(const void *waited_for, uint64_t begun);

/* A message that is being published: its reader may have it before the call has returned. */
struct offer {
  struct ledger_endpoint *endpoint; /* NULL: it is not counted */
  uint32_t generation;
};
/* Between count_enter and the middleware's call. */
struct offer count_offer(const void *publisher);
void count_publish(struct offer offer, bool taken);

/* This thread waits for work: what it took has been handled. */
void count_wait(void);
void count_start(const void *callback, bool intra);
void count_end(const void *callback);

/* A timer was called that goes by the machine's clock. */
void count_machine_timer(void);

/* Calls into rmw that are inside of another: only the outermost counts. */
void count_enter(void);
/* Whether the call that ends here was the outermost. */
bool count_leave(void);
