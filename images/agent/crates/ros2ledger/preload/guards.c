#include "guards.h"

#include <stdatomic.h>
#include <stdbool.h>
#include <string.h>

#include "attach.h"

#define PLACES 4096u
#define PLACE_BITS 12
/* A guard is at most so many places from its own; one that finds none is no work. */
#define PROBES 32u
#define REMOVED 1u

#define AWAITED 1u   /* a thread waits for it */
#define TRIGGERED 2u /* and no wait was woken by it yet */
#define BEGAN 4u     /* it is counted as work */

struct place {
  _Atomic uintptr_t guard; /* 0: never used */
  _Atomic uint32_t state;
};

static struct place places[PLACES];

static struct place *find(const void *guard, bool add) {
  uintptr_t wanted = (uintptr_t)guard;
  uint64_t hash = wanted * 0x9e3779b97f4a7c15ull;
  struct place *removed = NULL;
  for (uint32_t probe = 0; wanted > REMOVED && probe < PROBES; probe++) {
    struct place *place = &places[((uint32_t)(hash >> (64 - PLACE_BITS)) + probe) % PLACES];
    uintptr_t found = atomic_load_explicit(&place->guard, memory_order_acquire);
    if (found == wanted) return place;
    if (found == REMOVED && removed == NULL) removed = place;
    if (found != 0) continue;
    if (!add) return NULL;
    if (removed != NULL) break;
    if (atomic_compare_exchange_strong(&place->guard, &found, wanted) || found == wanted)
      return place;
  }
  uintptr_t free_place = REMOVED;
  if (!add || removed == NULL) return NULL;
  return atomic_compare_exchange_strong(&removed->guard, &free_place, wanted) ? removed : NULL;
}

static void add(struct ledger *ledger, _Atomic uint64_t *count, enum ledger_event event) {
  atomic_fetch_add(count, 1);
  changed(ledger, event);
}

static void began(void) {
  uint32_t entry;
  struct ledger *ledger = attached(&entry);
  add(ledger, &ledger->process[entry].others_started, EVENT_STARTED);
}

static void ended(void) {
  uint32_t entry;
  struct ledger *ledger = attached(&entry);
  add(ledger, &ledger->process[entry].others_ended, EVENT_ENDED);
}

static bool counts(void) {
  uint32_t entry;
  return attached(&entry) != NULL;
}

/* What woke the last wait is over. What was triggered since is found by this wait at once. */
static void wait_for(struct place *place) {
  uint32_t before = atomic_load(&place->state), after;
  do {
    after = AWAITED | (before & TRIGGERED ? TRIGGERED | BEGAN : 0);
  } while (!atomic_compare_exchange_weak(&place->state, &before, after));
  if (after & BEGAN) began();
  if (before & BEGAN) ended();
}

static size_t some(const struct set *guards) {
  if (guards == NULL || guards->things == NULL || !counts()) return 0;
  return guards->count < GUARDS ? guards->count : GUARDS;
}

void guards_wait(const struct set *guards, struct awaited *awaited) {
  awaited->count = some(guards);
  for (size_t one = 0; one < awaited->count; one++) {
    struct place *place = find(guards->things[one], true);
    if (place != NULL) wait_for(place);
    awaited->places[one] = place;
  }
}

/* Of those that are ready it is not known who triggered them last: they stay counted until they are
 * waited for again. */
void guards_woken(const struct set *guards, const struct awaited *awaited, bool ready) {
  for (size_t one = 0; one < awaited->count; one++) {
    struct place *place = awaited->places[one];
    bool woke = ready && guards->things[one] != NULL;
    if (place != NULL) atomic_fetch_and(&place->state, woke ? BEGAN : BEGAN | TRIGGERED);
  }
}

/* Before it is triggered, so that who is woken by it finds it counted. One that nobody waits for may
 * never be waited for again: it is work once it is. */
void guard_triggered(const struct guard_head *guard) {
  struct place *place = counts() ? find(guard->data, false) : NULL;
  if (place == NULL) return;
  uint32_t before = atomic_load(&place->state), after;
  do {
    after = before | TRIGGERED | (before & AWAITED ? BEGAN : 0);
  } while (!atomic_compare_exchange_weak(&place->state, &before, after));
  if (after & ~before & BEGAN) began();
}

void guard_destroyed(const struct guard_head *guard) {
  struct place *place = counts() ? find(guard->data, false) : NULL;
  if (place == NULL) return;
  uint32_t left = atomic_exchange(&place->state, 0);
  atomic_store(&place->guard, REMOVED);
  if (left & BEGAN) ended();
}

void guards_forget(void) { memset(places, 0, sizeof places); }
