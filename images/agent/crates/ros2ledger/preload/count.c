#define _GNU_SOURCE
#include "count.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <linux/futex.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <unistd.h>

#include "addresses.h"

#define NO_PROCESS UINT32_MAX
/* Callbacks inside of each other on one thread; beyond, the outermost one's end is lost. */
#define NESTED 16u
/* Callbacks whose subscription was not yet introduced. */
#define STRAYS 256u

/* The slot is not given to another endpoint while one of its callbacks runs (src/ledger.rs). */
struct call {
  const void *callback;
  uint32_t slot;
  bool intra;
};

/* What a thread does. */
static __thread struct {
  uint32_t inside;
  uint32_t id;
  uint32_t took;    /* the slot that it last took from */
  uint64_t in_hand; /* messages taken there, which have no callback that we see */
  uint32_t calls;
  struct call call[NESTED];
} self __attribute__((tls_model("initial-exec")));

struct stray {
  const void *subscription, *callback;
};

static char path[PATH_MAX];
static struct ledger *_Atomic shared; /* mapped once, kept until the process ends */
static _Atomic uint32_t own = NO_PROCESS;
/* Below: under the lock. */
static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static bool refused; /* there is no ledger, or no room in it */
static struct stray strays[STRAYS];
static uint32_t next_stray;

/* A child has its parent's memory and must not count for it. Only what a child may do is done:
 * the addresses are forgotten when it lists an endpoint of its own. */
static void in_child(void) {
  pthread_mutex_t fresh = PTHREAD_MUTEX_INITIALIZER;
  lock = fresh;
  atomic_store(&own, NO_PROCESS);
  refused = false;
  memset(&self, 0, sizeof self);
}

__attribute__((constructor)) static void begin(void) {
  const char *named = getenv("BAGPIPE_LEDGER");
  if (named == NULL || strlen(named) >= sizeof path) return;
  strcpy(path, named);
  /* Without it a child would count for its parent: better not at all. */
  if (pthread_atfork(NULL, NULL, in_child) != 0) path[0] = 0;
}

/* Only memory that nobody can shorten: a shorter one would end this process with SIGBUS. */
static struct ledger *map(void) {
  if (path[0] == 0) return NULL;
  int file = open(path, O_RDWR | O_CLOEXEC);
  if (file < 0) return NULL;
  struct ledger *ledger = NULL;
  int seals = fcntl(file, F_GET_SEALS);
  if (seals >= 0 && (seals & F_SEAL_SHRINK) && lseek(file, 0, SEEK_END) == sizeof *ledger) {
    void *mapped = mmap(NULL, sizeof *ledger, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    if (mapped != MAP_FAILED) ledger = mapped;
  }
  close(file);
  if (ledger == NULL) return NULL;
  struct ledger_header *header = &ledger->header;
  if (header->magic == LEDGER_MAGIC && header->version == LEDGER_VERSION &&
      header->processes == LEDGER_PROCESSES && header->endpoints == LEDGER_ENDPOINTS)
    return ledger;
  munmap(ledger, sizeof *ledger);
  return NULL;
}

/* Field 22 of /proc/self/stat; 0 if it can't be read, which no process has. */
static uint64_t start_time(void) {
  char text[1024];
  int file = open("/proc/self/stat", O_RDONLY | O_CLOEXEC);
  if (file < 0) return 0;
  ssize_t length = read(file, text, sizeof text - 1);
  close(file);
  if (length <= 0) return 0;
  text[length] = 0;
  char *at = strrchr(text, ')'); /* the name may have spaces */
  for (int field = 2; at != NULL && field < 22; field++) at = strchr(at + 1, ' ');
  return at == NULL ? 0 : strtoull(at + 1, NULL, 10);
}

/* Takes an entry of the table of processes. A program that was executed has the number and the
 * start time of the one before it, whose endpoints are no more. */
static uint32_t claim_process(struct ledger *ledger) {
  uint32_t pid = (uint32_t)getpid();
  uint64_t start = start_time();
  uint32_t mine = NO_PROCESS;
  for (uint32_t entry = 0; start != 0 && entry < LEDGER_PROCESSES; entry++) {
    struct ledger_process *process = &ledger->process[entry];
    uint32_t nobody = 0;
    if (process->pid == pid && process->start == start) {
      atomic_store(&process->state, PROCESS_REPLACED);
    } else if (mine == NO_PROCESS &&
               atomic_compare_exchange_strong(&process->pid, &nobody, pid)) {
      atomic_store(&process->start, start);
      atomic_store(&process->unlisted_endpoints, 0);
      atomic_store(&process->state, PROCESS_LIVE);
      mine = entry;
    }
  }
  return mine;
}

/* Under the lock: whether this process may count. */
static bool attached(void) {
  if (atomic_load(&own) != NO_PROCESS) return true;
  if (refused) return false;
  int kept = errno;
  if (atomic_load(&shared) == NULL) atomic_store(&shared, map());
  struct ledger *ledger = atomic_load(&shared);
  uint32_t mine = NO_PROCESS;
  if (ledger != NULL) {
    address_forget_all();
    memset(strays, 0, sizeof strays);
    mine = claim_process(ledger);
    if (mine == NO_PROCESS) atomic_fetch_add(&ledger->header.unlisted_processes, 1);
  }
  refused = mine == NO_PROCESS;
  atomic_store(&own, mine);
  errno = kept;
  return !refused;
}

/* Wakes who waits for such an event, once for each time that somebody asks for it. The figure that
 * changed was written before: whoever asks later finds it. */
static void changed(enum ledger_event event) {
  struct ledger_header *header = &atomic_load(&shared)->header;
  if (atomic_load(&header->wanted[event]) == 0) return;
  if (atomic_exchange(&header->wanted[event], 0) == 0) return;
  atomic_fetch_add(&header->changes, 1);
  syscall(SYS_futex, &header->changes, FUTEX_WAKE, INT_MAX, NULL, NULL, 0);
}

/* The endpoint of an address, or NULL. */
static struct ledger_endpoint *find(const void *address, uint32_t *slot) {
  if (atomic_load_explicit(&own, memory_order_acquire) == NO_PROCESS) return NULL;
  *slot = address_find(address);
  return *slot == NO_SLOT ? NULL : &atomic_load(&shared)->endpoint[*slot];
}

static void add(_Atomic uint64_t *count, uint64_t more, enum ledger_event event) {
  atomic_fetch_add(count, more);
  changed(event);
}

static void note_thread(struct ledger_endpoint *endpoint) {
  if (self.id == 0) self.id = (uint32_t)syscall(SYS_gettid);
  if (atomic_load_explicit(&endpoint->thread, memory_order_relaxed) != self.id)
    atomic_store_explicit(&endpoint->thread, self.id, memory_order_relaxed);
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

static void fill(struct ledger_endpoint *endpoint, enum ledger_kind kind, const char *topic,
                 const struct qos_head *qos) {
  atomic_fetch_add(&endpoint->generation, 1);
  endpoint->kind = kind;
  endpoint->flags = 0;
  endpoint->history = (uint32_t)qos->history;
  endpoint->reliability = (uint32_t)qos->reliability;
  endpoint->durability = (uint32_t)qos->durability;
  endpoint->depth = qos->depth;
  endpoint->thread = 0;
  for (_Atomic uint64_t *count = &endpoint->taken; count <= &endpoint->published; count++)
    *count = 0;
  size_t length = strlen(topic);
  for (size_t byte = 0; byte <= length; byte++) endpoint->topic[byte] = (uint8_t)topic[byte];
}

/* Under the lock. False where there is no room. */
static bool list(enum ledger_kind kind, const void *address, const char *topic,
                 const struct qos_head *qos) {
  struct ledger *ledger = atomic_load(&shared);
  uint32_t owner = atomic_load(&own);
  uint32_t slot = strlen(topic) < LEDGER_TOPIC_BYTES ? claim_slot(ledger, owner) : NO_SLOT;
  if (slot == NO_SLOT) return false;
  struct ledger_endpoint *endpoint = &ledger->endpoint[slot];
  fill(endpoint, kind, topic, qos);
  note_used(ledger, slot);
  bool known = address_put(address, slot);
  uint32_t phase = known ? PHASE_LIVE : PHASE_DESTROYED;
  atomic_store(&endpoint->state, phase | owner << LEDGER_OWNER_SHIFT);
  return known;
}

/* Under the lock: this address' events are not counted, which the reader must know. */
static void unlisted(void) {
  struct ledger *ledger = atomic_load(&shared);
  atomic_fetch_add(&ledger->process[atomic_load(&own)].unlisted_endpoints, 1);
  atomic_fetch_add(&ledger->header.unlisted_endpoints, 1);
}

void count_listed(enum ledger_kind kind, const void *address, const char *topic,
                  const struct qos_head *qos) {
  pthread_mutex_lock(&lock);
  if (attached()) {
    if (!list(kind, address, topic, qos)) unlisted();
    changed(EVENT_LISTED);
  }
  pthread_mutex_unlock(&lock);
}

void count_destroyed(const void *address) {
  pthread_mutex_lock(&lock);
  uint32_t slot;
  struct ledger_endpoint *endpoint = find(address, &slot);
  if (endpoint != NULL) {
    address_forget(slot);
    atomic_store(&endpoint->state, PHASE_DESTROYED | atomic_load(&own) << LEDGER_OWNER_SHIFT);
    changed(EVENT_LISTED);
  }
  pthread_mutex_unlock(&lock);
}

/* Under the lock. */
static void join(const void *known, const void *also, uint32_t flags) {
  uint32_t slot;
  struct ledger_endpoint *endpoint = find(known, &slot);
  if (endpoint == NULL) return;
  if (address_put(also, slot))
    atomic_fetch_or(&endpoint->flags, flags);
  else
    unlisted();
}

void count_link(const void *known, const void *also, uint32_t flags) {
  pthread_mutex_lock(&lock);
  join(known, also, flags);
  pthread_mutex_unlock(&lock);
}

void count_callback(const void *subscription, const void *callback) {
  uint32_t slot;
  pthread_mutex_lock(&lock);
  if (find(subscription, &slot) != NULL)
    join(subscription, callback, FLAG_CALLS);
  else
    strays[next_stray++ % STRAYS] = (struct stray){subscription, callback};
  pthread_mutex_unlock(&lock);
}

void count_introduced(const void *rcl, const void *subscription) {
  pthread_mutex_lock(&lock);
  join(rcl, subscription, 0);
  for (struct stray *stray = strays; stray < strays + STRAYS; stray++) {
    if (stray->subscription != subscription) continue;
    /* Only an intra-process subscription has its callback before it is introduced. */
    join(subscription, stray->callback, FLAG_INTRA);
    *stray = (struct stray){NULL, NULL};
  }
  pthread_mutex_unlock(&lock);
}

/* Whoever takes again or waits has done with what it took before. */
void count_wait(void) {
  if (self.in_hand == 0) return;
  uint64_t done = self.in_hand;
  self.in_hand = 0;
  add(&atomic_load(&shared)->endpoint[self.took].returned, done, EVENT_ENDED);
}

void count_take(const void *subscription, uint64_t messages) {
  uint32_t slot;
  count_wait();
  struct ledger_endpoint *endpoint = find(subscription, &slot);
  if (endpoint == NULL) return;
  if (messages == 0) {
    atomic_fetch_add_explicit(&endpoint->empty, 1, memory_order_relaxed);
    return;
  }
  note_thread(endpoint);
  if (!(atomic_load_explicit(&endpoint->flags, memory_order_relaxed) & FLAG_CALLS)) {
    self.took = slot;
    self.in_hand = messages;
  }
  add(&endpoint->taken, messages, EVENT_TAKEN);
}

void count_publish(const void *publisher) {
  uint32_t slot;
  struct ledger_endpoint *endpoint = find(publisher, &slot);
  if (endpoint != NULL) add(&endpoint->published, 1, EVENT_PUBLISHED);
}

void count_start(const void *callback, bool intra) {
  uint32_t slot;
  struct ledger_endpoint *endpoint = find(callback, &slot);
  if (endpoint == NULL) return;
  if (self.calls == NESTED) {
    memmove(self.call, self.call + 1, sizeof self.call - sizeof self.call[0]);
    self.calls--;
  }
  self.call[self.calls++] = (struct call){callback, slot, intra};
  note_thread(endpoint);
  if (!intra && !(atomic_load_explicit(&endpoint->flags, memory_order_relaxed) & FLAG_CALLS))
    atomic_fetch_or(&endpoint->flags, FLAG_CALLS);
  add(intra ? &endpoint->intra_started : &endpoint->started, 1, EVENT_STARTED);
}

void count_end(const void *callback) {
  for (uint32_t depth = self.calls; depth > 0; depth--) {
    struct call call = self.call[depth - 1];
    if (call.callback != callback) continue;
    /* Those above it were left by an exception: they have no end. */
    self.calls = depth - 1;
    struct ledger_endpoint *endpoint = &atomic_load(&shared)->endpoint[call.slot];
    add(call.intra ? &endpoint->intra_ended : &endpoint->ended, 1, EVENT_ENDED);
    return;
  }
}

void count_enter(void) { self.inside++; }

/* 0 already: a child began inside of its parent's call. */
bool count_leave(void) { return self.inside > 0 && --self.inside == 0; }
