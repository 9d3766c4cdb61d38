/* The ledger's shared memory: the same definition as src/layout.rs, which a test compares with it
 * field by field. Little-endian, native alignment, nothing but atomics. */
#pragma once
#include <stdatomic.h>
#include <stdint.h>

#define LEDGER_MAGIC 0x3152444c50474142ull /* "BAGPLDR1" */
#define LEDGER_VERSION 10u
#define LEDGER_PROCESSES 512u
#define LEDGER_ENDPOINTS 4096u
#define LEDGER_NAME_BYTES 256u
#define LEDGER_EXITED 256u /* beside the 8 bits that a parent is given of a status */
#define LEDGER_OWN 4096u /* a power of two, of which half are used at the most */

/* What somebody may wait for: an index into `wanted`. */
enum ledger_event {
  EVENT_TAKEN,
  EVENT_STARTED,
  EVENT_ENDED,
  EVENT_PUBLISHED,
  EVENT_LISTED,
  EVENT_MATCHED,
  EVENTS
};

/* The low byte of an endpoint's state; the process that owns it is above. */
enum ledger_phase { PHASE_FREE, PHASE_CLAIMED, PHASE_LIVE, PHASE_DESTROYED };
#define LEDGER_OWNER_SHIFT 8

enum ledger_process_state { PROCESS_FREE, PROCESS_LIVE, PROCESS_REPLACED };

enum ledger_kind { KIND_SUBSCRIPTION = 1, KIND_PUBLISHER = 2 };

/* The callback is known, so that starts and ends are counted; so is an intra-process one; a subscription
 * that was listed after one of `own` had published, and takes no other's place; one whose place nobody
 * takes any more; one of which the program shows by itself that it is there. */
enum ledger_flag { FLAG_CALLS = 1, FLAG_INTRA = 2, FLAG_LATE = 4, FLAG_REPLACED = 8, FLAG_MANUAL = 16 };

/* Whether a node that publishes waits for room in its receivers' sockets, and how long. */
enum ledger_flow { FLOW_FREE, FLOW_CONTROLLED, FLOW_BY_THE_CLOCK };

struct ledger_header {
  _Atomic uint64_t magic;
  _Atomic uint32_t version;
  _Atomic uint32_t processes;
  _Atomic uint32_t endpoints;
  _Atomic uint32_t unlisted_processes; /* found the table of processes full */
  _Atomic uint32_t unlisted_endpoints; /* of all processes: found the table full */
  _Atomic uint32_t endpoints_used;     /* slots beyond were never used */
  _Atomic uint64_t reserved[4];
  _Atomic uint32_t changes; /* the futex */
  _Atomic uint32_t wanted[EVENTS]; /* not 0: somebody is to be woken by the next such event */
  _Atomic uint32_t watch_matches; /* not 0: the number of the watch that asks for matches */
  _Atomic uint32_t listings; /* endpoints that were ever listed, each once it can be read */
  _Atomic uint32_t own_published; /* not 0: one of `own` has published */
  _Atomic uint32_t flow; /* how what nodes publish is held back: an enum ledger_flow */
  _Atomic uint32_t reserved_wanted[5];
};

struct ledger_process {
  _Atomic uint32_t pid;
  _Atomic uint32_t state;
  _Atomic uint64_t start; /* clock ticks since boot: field 22 of /proc/PID/stat */
  _Atomic uint32_t unlisted_endpoints;
  _Atomic uint32_t spinners; /* threads that have taken or waited */
  _Atomic uint64_t others_started; /* callbacks of no subscription: timers, services */
  _Atomic uint64_t others_ended;
  _Atomic uint64_t stack; /* where it begins: field 28, which exec changes */
  _Atomic uint64_t machine_timers; /* calls of timers that go by the machine's clock */
  _Atomic uint32_t exit_status; /* that it calls exit() with, and LEDGER_EXITED; 0: not seen */
  _Atomic uint32_t reserved_word;
};

struct ledger_endpoint {
  _Atomic uint32_t state;
  _Atomic uint32_t generation; /* which use of this slot it is */
  _Atomic uint32_t kind;
  _Atomic uint32_t flags;
  _Atomic uint32_t history;
  _Atomic uint32_t reliability;
  _Atomic uint32_t durability;
  _Atomic uint32_t thread; /* the last that took or called */
  _Atomic uint64_t depth;
  _Atomic uint64_t matched; /* publishers, in the low half; above, the watch that asked for them */
  _Atomic uint64_t wake_from; /* who waits for takes is not woken before so many */
  _Atomic uint64_t offered; /* published, and those of which the middleware has not returned yet */
  _Atomic uint64_t taken;
  _Atomic uint64_t rested; /* one more than was taken when nothing was left to take; 0: not seen */
  _Atomic uint64_t started;
  _Atomic uint64_t ended;
  _Atomic uint64_t intra_started; /* intra-process: without a take */
  _Atomic uint64_t intra_ended;
  _Atomic uint64_t returned; /* not called: the thread that took came back to take or to wait, or ended */
  _Atomic uint64_t published;
  _Atomic uint8_t topic[LEDGER_NAME_BYTES]; /* ends with a 0, as the next does */
  _Atomic uint8_t node[LEDGER_NAME_BYTES];  /* "/namespace/name"; empty: not known */
  /* CLOCK_MONOTONIC in nanoseconds, during a watch: a moment of that rest; of a publisher, when its
   * last call has returned. 0: not seen. */
  _Atomic uint64_t seen_at;
  /* Of those taken: whose publisher is one of `own`, and that were published after `own_after`; and
   * whose publisher was not to be known. */
  _Atomic uint64_t taken_own;
  _Atomic uint64_t taken_unknown;
  /* Stamps of the source, in ns since 1970: the latest of `own` that was taken; and the one after which
   * they count, as what is kept for who comes late is given to this one too: the latest that the node
   * had taken by one that it destroyed before, whose place this one takes; otherwise, of a late one,
   * when it was listed. */
  _Atomic int64_t own_latest;
  _Atomic int64_t own_after;
  _Atomic uint64_t destroyed; /* which of its process' endpoints that were, from 1 on */
  _Atomic uint64_t deadline, lease; /* ns, as was asked for; 0: without end */
  _Atomic uint64_t gid[2]; /* of a publisher, by which the graph has it; 0 and 0: not known */
  _Atomic uint64_t reserved[6];
};

struct ledger {
  struct ledger_header header;
  struct ledger_process process[LEDGER_PROCESSES];
  struct ledger_endpoint endpoint[LEDGER_ENDPOINTS];
  /* The reader's own publishers, by their keys (origin.h): each at its key's place or in the first one
   * behind that was free. 0: free. */
  _Atomic uint64_t own[LEDGER_OWN];
};

_Static_assert(sizeof(struct ledger_header) == 128, "two lines of cache");
_Static_assert(sizeof(struct ledger_process) == 64, "a line of cache");
_Static_assert(sizeof(struct ledger_endpoint) == 768, "twelve lines of cache");
