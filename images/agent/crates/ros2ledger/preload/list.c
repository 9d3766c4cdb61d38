#include "list.h"

#include <stdio.h>
#include <string.h>
#include <time.h>

#include "guards.h"
#include "matches.h"
#include "origin.h"

/* Callbacks whose subscription was not yet introduced. */
#define STRAYS 256u

struct stray {
  const void *subscription, *callback;
};

static struct stray strays[STRAYS];
static uint32_t next_stray;
static uint64_t destroyed; /* endpoints, by now */

static void forget_all(void) {
  address_forget_all();
  matches_forget();
  origin_forget();
  guards_forget();
  memset(strays, 0, sizeof strays);
}

static uint32_t claim_slot(struct ledger *ledger, uint32_t owner) {
  uint32_t claimed = PHASE_CLAIMED | owner << LEDGER_OWNER_SHIFT;
  for (uint32_t slot = 0; slot < LEDGER_ENDPOINTS; slot++) {
    uint32_t free_slot = PHASE_FREE;
    _Atomic uint32_t *state = &ledger->endpoint[slot].state;
    if (atomic_load_explicit(state, memory_order_relaxed) == PHASE_FREE &&
        atomic_compare_exchange_strong(state, &free_slot, claimed))
      return slot;
  }
  return NO_SLOT;
}

static void note_used(struct ledger *ledger, uint32_t slot) {
  _Atomic uint32_t *used = &ledger->header.endpoints_used;
  uint32_t before = atomic_load(used);
  while (before <= slot && !atomic_compare_exchange_weak(used, &before, slot + 1)) continue;
}

/* The node's full name; false where it does not fit. */
static bool full_name(const struct node_head *node, char name[LEDGER_NAME_BYTES]) {
  name[0] = 0;
  if (node == NULL || node->name == NULL || node->space == NULL) return true;
  size_t length = strlen(node->space);
  const char *between = length > 0 && node->space[length - 1] == '/' ? "" : "/";
  int needed = snprintf(name, LEDGER_NAME_BYTES, "%s%s%s", node->space, between, node->name);
  return needed >= 0 && (size_t)needed < LEDGER_NAME_BYTES;
}

static void copy(_Atomic uint8_t *into, const char *name) {
  size_t length = strlen(name);
  for (size_t byte = 0; byte <= length; byte++) into[byte] = (uint8_t)name[byte];
}

/* In ns; 0 of one without end: of none, and of those that rmw means by infinite and best available. */
static uint64_t time_of(struct rmw_time time) {
  bool endless = time.seconds >= UINT64_MAX / 1000000000 / 2;
  return endless ? 0 : time.seconds * 1000000000 + time.nanoseconds;
}

static void fill(struct ledger_endpoint *endpoint, const struct creation *of, const char *node) {
  atomic_fetch_add(&endpoint->generation, 1);
  endpoint->kind = of->kind;
  endpoint->flags = of->qos.liveliness == LIVELINESS_MANUAL_BY_TOPIC ? FLAG_MANUAL : 0;
  endpoint->history = (uint32_t)of->qos.history;
  endpoint->reliability = (uint32_t)of->qos.reliability;
  endpoint->durability = (uint32_t)of->qos.durability;
  endpoint->depth = of->qos.depth;
  endpoint->thread = 0;
  endpoint->matched = 0;
  endpoint->wake_from = 0;
  endpoint->offered = 0;
  for (_Atomic uint64_t *count = &endpoint->taken; count <= &endpoint->published; count++)
    *count = 0;
  endpoint->seen_at = 0;
  endpoint->taken_own = 0;
  endpoint->taken_unknown = 0;
  endpoint->own_latest = 0;
  endpoint->own_after = 0;
  endpoint->destroyed = 0;
  endpoint->deadline = time_of(of->qos.deadline);
  endpoint->lease = time_of(of->qos.lease);
  endpoint->gid[0] = of->gid[0];
  endpoint->gid[1] = of->gid[1];
  copy(endpoint->topic, of->topic);
  copy(endpoint->node, node);
}

static bool same(const _Atomic uint8_t *one, const _Atomic uint8_t *other) {
  for (uint32_t byte = 0; byte < LEDGER_NAME_BYTES; byte++) {
    if (one[byte] != other[byte]) return false;
    if (one[byte] == 0) break;
  }
  return true;
}

static int64_t now(void) {
  struct timespec time;
  clock_gettime(CLOCK_REALTIME, &time);
  return (int64_t)time.tv_sec * 1000000000 + time.tv_nsec;
}

/* The one whose place this one takes: the last of those that this node has destroyed. */
static struct ledger_endpoint *find_replaced(struct ledger *ledger, uint32_t owner,
                                             struct ledger_endpoint *made) {
  struct ledger_endpoint *replaced = NULL;
  uint32_t used = atomic_load(&ledger->header.endpoints_used);
  for (uint32_t slot = 0; slot < used && slot < LEDGER_ENDPOINTS; slot++) {
    struct ledger_endpoint *one = &ledger->endpoint[slot];
    bool destroyed = atomic_load(&one->state) == (PHASE_DESTROYED | owner << LEDGER_OWNER_SHIFT);
    if (!destroyed || (atomic_load(&one->flags) & FLAG_REPLACED) || one->kind != made->kind ||
        !same(one->topic, made->topic) || !same(one->node, made->node))
      continue;
    if (replaced == NULL || one->destroyed > replaced->destroyed) replaced = one;
  }
  return replaced;
}

/* From which message on this subscription counts. Of what is kept, nothing was sent to one that comes late
 * and takes no other's place. */
static void note_beginning(struct ledger *ledger, uint32_t owner, struct ledger_endpoint *made) {
  struct ledger_endpoint *replaced = find_replaced(ledger, owner, made);
  if (replaced != NULL) {
    int64_t own = atomic_load(&replaced->own_latest), after = atomic_load(&replaced->own_after);
    made->own_after = own > after ? own : after;
    atomic_fetch_or(&replaced->flags, FLAG_REPLACED);
  } else if (atomic_load(&ledger->header.own_published) != 0) {
    made->own_after = now();
    atomic_fetch_or(&made->flags, FLAG_LATE);
  }
}

/* Under the lock. False where there is no room. */
static bool list(struct ledger *ledger, uint32_t owner, const struct creation *of) {
  char node[LEDGER_NAME_BYTES];
  bool fits = full_name(of->node, node) && strlen(of->topic) < LEDGER_NAME_BYTES;
  uint32_t slot = fits ? claim_slot(ledger, owner) : NO_SLOT;
  if (slot == NO_SLOT) return false;
  struct ledger_endpoint *endpoint = &ledger->endpoint[slot];
  fill(endpoint, of, node);
  if (of->kind == KIND_SUBSCRIPTION) note_beginning(ledger, owner, endpoint);
  note_used(ledger, slot);
  bool known = address_put(of->address, slot);
  if (known) matches_of(slot, of->kind, of->address);
  /* Without room for it, it is not seen when nothing is left to take, and nothing is miscounted. */
  const void *data = of->address->data;
  if (known && of->kind == KIND_SUBSCRIPTION && data != NULL) address_put(data, slot);
  /* Nor is it one of those that count by its number. */
  if (!known) endpoint->gid[0] = endpoint->gid[1] = 0;
  uint32_t phase = known ? PHASE_LIVE : PHASE_DESTROYED;
  atomic_store(&endpoint->state, phase | owner << LEDGER_OWNER_SHIFT);
  atomic_fetch_add(&ledger->header.listings, 1);
  return known;
}

/* Under the lock: this address' events are not counted, which the reader must know. */
static void unlisted(struct ledger *ledger, uint32_t owner) {
  atomic_fetch_add(&ledger->process[owner].unlisted_endpoints, 1);
  atomic_fetch_add(&ledger->header.unlisted_endpoints, 1);
}

void list_endpoint(const struct creation *of) {
  pthread_mutex_lock(&attach_lock);
  if (attach(forget_all)) {
    uint32_t owner;
    struct ledger *ledger = attached(&owner);
    if (!list(ledger, owner, of)) unlisted(ledger, owner);
    changed(ledger, EVENT_LISTED);
  }
  pthread_mutex_unlock(&attach_lock);
}

void list_destroyed(const void *address) {
  pthread_mutex_lock(&attach_lock);
  uint32_t slot, owner;
  struct ledger *ledger = attached(&owner);
  struct ledger_endpoint *endpoint = listed(address, &slot);
  if (endpoint != NULL) {
    address_forget(slot);
    matches_of(slot, endpoint->kind, NULL);
    endpoint->destroyed = ++destroyed;
    atomic_store(&endpoint->state, PHASE_DESTROYED | owner << LEDGER_OWNER_SHIFT);
    changed(ledger, EVENT_LISTED);
  }
  pthread_mutex_unlock(&attach_lock);
}

/* Under the lock. */
static void join(const void *known, const void *also, uint32_t flags) {
  uint32_t slot, owner;
  struct ledger *ledger = attached(&owner);
  struct ledger_endpoint *endpoint = listed(known, &slot);
  if (endpoint == NULL) return;
  if (address_put(also, slot))
    atomic_fetch_or(&endpoint->flags, flags);
  else
    unlisted(ledger, owner);
}

void list_link(const void *known, const void *also, uint32_t flags) {
  pthread_mutex_lock(&attach_lock);
  join(known, also, flags);
  pthread_mutex_unlock(&attach_lock);
}

void list_callback(const void *subscription, const void *callback) {
  uint32_t slot;
  pthread_mutex_lock(&attach_lock);
  if (listed(subscription, &slot) != NULL)
    join(subscription, callback, FLAG_CALLS);
  else
    strays[next_stray++ % STRAYS] = (struct stray){subscription, callback};
  pthread_mutex_unlock(&attach_lock);
}

void list_introduced(const void *rcl, const void *subscription) {
  pthread_mutex_lock(&attach_lock);
  join(rcl, subscription, 0);
  for (struct stray *stray = strays; stray < strays + STRAYS; stray++) {
    if (stray->subscription != subscription) continue;
    /* Only an intra-process subscription has its callback before it is introduced. */
    join(subscription, stray->callback, FLAG_INTRA);
    *stray = (struct stray){NULL, NULL};
  }
  pthread_mutex_unlock(&attach_lock);
}
