#define _GNU_SOURCE
#include "count.h"

#include <string.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

#include "attach.h"
#include "list.h"
#include "matches.h"
#include "sending.h"

/* Callbacks inside of each other on one thread; beyond, the outermost one's end is lost. */
#define NESTED 16u

/* The slot is not given to another endpoint while one of its callbacks runs (src/ledger.rs). */
struct call {
  const void *callback;
  uint32_t slot; /* NO_SLOT: no subscription's */
  bool intra;
};

/* What a thread does. */
static __thread struct {
  bool has_end; /* at_end will be called */
  bool spins;   /* it is counted among those that take or wait */
  uint32_t inside;
  uint32_t id;
  uint32_t took;    /* the slot that it last took from */
  uint64_t in_hand; /* messages taken there, of which no callback has begun */
  uint32_t calls;
  struct call call[NESTED];
} self __attribute__((tls_model("initial-exec")));

/* Only what a child may do is done: the addresses are forgotten when it lists an endpoint of its
 * own. */
static void in_child(void) {
  attach_child();
  sending_in_child();
  memset(&self, 0, sizeof self);
}

__attribute__((constructor)) static void begin(void) { attach_begin(in_child); }

static void add(_Atomic uint64_t *count, uint64_t more, enum ledger_event event) {
  atomic_fetch_add(count, more);
  changed(atomic_load_explicit(&attach_ledger, memory_order_relaxed), event);
}

static void note_thread(struct ledger_endpoint *endpoint) {
  if (self.id == 0) self.id = (uint32_t)syscall(SYS_gettid);
  if (atomic_load_explicit(&endpoint->thread, memory_order_relaxed) != self.id)
    atomic_store_explicit(&endpoint->thread, self.id, memory_order_relaxed);
}

static void note_spinner(void) {
  uint32_t entry;
  struct ledger *ledger = attached(&entry);
  if (ledger == NULL) return;
  self.spins = true;
  atomic_fetch_add(&ledger->process[entry].spinners, 1);
}

/* Whoever takes again or waits has done with what it took before. */
static void come_back(void) {
  if (self.in_hand == 0) return;
  uint64_t done = self.in_hand;
  self.in_hand = 0;
  add(&atomic_load(&attach_ledger)->endpoint[self.took].returned, done, EVENT_ENDED);
}

void count_wait(void) {
  if (!self.spins) note_spinner();
  come_back();
}

/* Of C++, for objects of a thread: the only one that is in every C library itself. */
int __cxa_thread_atexit_impl(void (*function)(void *), void *argument, void *library);
extern void *__dso_handle;

/* A thread that ends has done with what it took. */
static void at_end(void *unused) {
  (void)unused;
  come_back();
}

static void meet_thread(void) {
  self.has_end = true;
  __cxa_thread_atexit_impl(at_end, NULL, &__dso_handle);
}

uint64_t count_moment(void) {
  if (matches_watched() == 0) return 0;
  struct timespec time;
  clock_gettime(CLOCK_MONOTONIC, &time);
  return (uint64_t)time.tv_sec * 1000000000ull + (uint64_t)time.tv_nsec;
}

/* The moment first: who reads both in the other order, and then what was taken, has no count with a
 * later moment than its own. */
static void note_rest(struct ledger_endpoint *endpoint, uint64_t begun) {
  if (begun == 0) return;
  atomic_store(&endpoint->seen_at, begun);
  atomic_store(&endpoint->rested, atomic_load(&endpoint->taken) + 1);
}

void count_rest(const void *waited_for, uint64_t begun) {
  uint32_t slot;
  struct ledger_endpoint *endpoint = listed(waited_for, &slot);
  if (endpoint != NULL) note_rest(endpoint, begun);
}

/* What the node has taken by another subscription counts no second time, and what was published before
 * it was there not at all. A middleware without stamps gives 0. */
static void note_own(struct ledger_endpoint *endpoint, uint64_t messages, int64_t stamp) {
  int64_t after = atomic_load_explicit(&endpoint->own_after, memory_order_relaxed);
  if (after != 0 && stamp != 0 && stamp <= after) return;
  int64_t latest = atomic_load(&endpoint->own_latest);
  while (latest < stamp && !atomic_compare_exchange_weak(&endpoint->own_latest, &latest, stamp))
    continue;
  atomic_fetch_add(&endpoint->taken_own, messages);
}

void count_take(const void *subscription, uint64_t messages, uint64_t begun, struct origin origin) {
  uint32_t slot;
  come_back();
  struct ledger_endpoint *endpoint = listed(subscription, &slot);
  /* The middleware's own threads take what announces others by the same functions: they are none of the
   * node's. */
  if (endpoint == NULL) return;
  if (!self.spins) note_spinner();
  if (messages == 0) {
    note_rest(endpoint, begun);
    return;
  }
  note_thread(endpoint);
  if (!self.has_end) meet_thread();
  self.took = slot;
  self.in_hand = messages;
  uint64_t taken = atomic_fetch_add(&endpoint->taken, messages) + messages;
  /* Behind all: who reads these first finds no more of them than were taken. */
  if (origin.whose == ORIGIN_OWN) note_own(endpoint, messages, origin.stamp);
  if (origin.whose == ORIGIN_UNKNOWN) atomic_fetch_add(&endpoint->taken_unknown, messages);
  if (taken >= atomic_load(&endpoint->wake_from)) changed(atomic_load(&attach_ledger), EVENT_TAKEN);
}

struct offer count_offer(const void *publisher) {
  uint32_t slot;
  struct offer offer = {NULL, 0};
  if (self.inside != 1) return offer;
  offer.endpoint = listed(publisher, &slot);
  if (offer.endpoint == NULL) return offer;
  offer.generation = atomic_load(&offer.endpoint->generation);
  atomic_fetch_add(&offer.endpoint->offered, 1);
  return offer;
}

void count_publish(struct offer offer, bool taken) {
  if (offer.endpoint == NULL) return;
  /* Destroyed by another thread meanwhile, and the slot is another's. */
  if (atomic_load(&offer.endpoint->generation) != offer.generation) return;
  if (taken) {
    uint64_t moment = count_moment();
    if (moment != 0) atomic_store(&offer.endpoint->seen_at, moment);
    add(&offer.endpoint->published, 1, EVENT_PUBLISHED);
  } else
    atomic_fetch_sub(&offer.endpoint->offered, 1);
}

static void start_endpoint(struct ledger_endpoint *endpoint, uint32_t slot, bool intra) {
  note_thread(endpoint);
  if (intra) {
    add(&endpoint->intra_started, 1, EVENT_STARTED);
    return;
  }
  if (slot == self.took && self.in_hand > 0) self.in_hand--;
  if (!(atomic_load_explicit(&endpoint->flags, memory_order_relaxed) & FLAG_CALLS))
    atomic_fetch_or(&endpoint->flags, FLAG_CALLS);
  add(&endpoint->started, 1, EVENT_STARTED);
}

void count_start(const void *callback, bool intra) {
  uint32_t entry;
  struct ledger *ledger = attached(&entry);
  if (ledger == NULL) return;
  if (self.calls == NESTED) {
    memmove(self.call, self.call + 1, sizeof self.call - sizeof self.call[0]);
    self.calls--;
  }
  uint32_t slot = address_find(callback);
  self.call[self.calls++] = (struct call){callback, slot, intra};
  if (slot == NO_SLOT)
    add(&ledger->process[entry].others_started, 1, EVENT_STARTED);
  else
    start_endpoint(&ledger->endpoint[slot], slot, intra);
}

static void end(struct ledger *ledger, uint32_t entry, struct call call) {
  if (call.slot == NO_SLOT) {
    add(&ledger->process[entry].others_ended, 1, EVENT_ENDED);
    return;
  }
  struct ledger_endpoint *endpoint = &ledger->endpoint[call.slot];
  add(call.intra ? &endpoint->intra_ended : &endpoint->ended, 1, EVENT_ENDED);
}

void count_end(const void *callback) {
  uint32_t entry;
  struct ledger *ledger = attached(&entry);
  if (ledger == NULL) return;
  for (uint32_t depth = self.calls; depth > 0; depth--) {
    struct call call = self.call[depth - 1];
    if (call.callback != callback) continue;
    /* Those above it were left by an exception: they have no end. */
    self.calls = depth - 1;
    end(ledger, entry, call);
    return;
  }
}

void count_machine_timer(void) {
  uint32_t entry;
  struct ledger *ledger = attached(&entry);
  if (ledger != NULL) atomic_fetch_add(&ledger->process[entry].machine_timers, 1);
}

void count_enter(void) { self.inside++; }

/* 0 already: a child began inside of its parent's call. */
bool count_leave(void) { return self.inside > 0 && --self.inside == 0; }
