/* How many publishers this process' subscriptions have matched, and how many subscriptions its
 * publishers, asked for while somebody watches. */
#pragma once
#include <stdint.h>

#include "layout.h"

/* Under the lock: from now on the endpoint of a slot is asked; NULL ends that. */
void matches_of(uint32_t slot, enum ledger_kind kind, const void *endpoint);
/* Under the lock. */
void matches_forget(void);
/* The number of the watch; 0 while nobody watches. */
uint32_t matches_watched(void);
/* Asks all of them, unless another thread does at the moment. */
void matches_sample(void);
