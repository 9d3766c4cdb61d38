#include "addresses.h"

#include <stdatomic.h>
#include <stddef.h>

#define PLACES 16384u
#define PLACE_BITS 14
/* An address is at most so many places from its own, so that no look-up is long. */
#define PROBES 64u
/* A place that was used: the address behind it may still be looked for. */
#define REMOVED 1u

struct place {
  _Atomic uintptr_t address; /* 0: never used */
  _Atomic uint32_t slot;
};

static struct place places[PLACES];

static struct place *place_of(uintptr_t address, uint32_t probe) {
  uint64_t hash = (uint64_t)address * 0x9e3779b97f4a7c15ull;
  return &places[((uint32_t)(hash >> (64 - PLACE_BITS)) + probe) % PLACES];
}

uint32_t address_find(const void *address) {
  uintptr_t wanted = (uintptr_t)address;
  for (uint32_t probe = 0; wanted > REMOVED && probe < PROBES; probe++) {
    struct place *place = place_of(wanted, probe);
    uintptr_t found = atomic_load(&place->address);
    if (found == 0) return NO_SLOT;
    if (found != wanted) continue;
    uint32_t slot = atomic_load(&place->slot);
    /* The place may have become another address' between the two. */
    if (atomic_load(&place->address) == wanted) return slot;
  }
  return NO_SLOT;
}

bool address_put(const void *address, uint32_t slot) {
  uintptr_t wanted = (uintptr_t)address;
  struct place *place = NULL;
  if (wanted <= REMOVED) return false;
  for (uint32_t probe = 0; probe < PROBES; probe++) {
    struct place *here = place_of(wanted, probe);
    uintptr_t found = atomic_load(&here->address);
    if (found == wanted || (found <= REMOVED && place == NULL)) place = here;
    if (found == wanted || found == 0) break;
  }
  if (place == NULL) return false;
  atomic_store(&place->address, REMOVED);
  atomic_store(&place->slot, slot);
  atomic_store(&place->address, wanted);
  return true;
}

void address_forget(uint32_t slot) {
  for (struct place *place = places; place < places + PLACES; place++) {
    if (atomic_load(&place->address) > REMOVED && atomic_load(&place->slot) == slot)
      atomic_store(&place->address, REMOVED);
  }
}

void address_forget_all(void) {
  for (struct place *place = places; place < places + PLACES; place++) {
    if (atomic_load(&place->address) != 0) atomic_store(&place->address, 0);
  }
}
