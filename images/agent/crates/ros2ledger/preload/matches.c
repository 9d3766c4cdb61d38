#include "matches.h"

#include <errno.h>
#include <stdbool.h>
#include <stddef.h>
#include <string.h>

#include "attach.h"
#include "next.h"

typedef int count_matched(const void *endpoint, size_t *others);

/* The middleware's functions, by kind. */
static count_matched *counts[KIND_PUBLISHER + 1];
static const char *const names[] = {
    [KIND_SUBSCRIPTION] = "rmw_subscription_count_matched_publishers",
    [KIND_PUBLISHER] = "rmw_publisher_count_matched_subscriptions",
};

/* All below is under the lock, so that nobody destroys an endpoint while it is asked. */
static struct {
  const void *address; /* NULL: not asked */
  enum ledger_kind kind;
} asked[LEDGER_ENDPOINTS];
static uint32_t used; /* slots beyond have none */

/* One thread of many that wait is enough. A lock that is only tried has a new version in new C
 * libraries. */
static _Atomic bool sampling;

void matches_of(uint32_t slot, enum ledger_kind kind, const void *endpoint) {
  asked[slot].address = endpoint;
  asked[slot].kind = kind;
  if (endpoint != NULL && used <= slot) used = slot + 1;
}

void matches_forget(void) {
  memset(asked, 0, sizeof asked);
  used = 0;
  atomic_store(&sampling, false); /* a child's parent may have been at it */
}

uint32_t matches_watched(void) {
  uint32_t entry;
  struct ledger *ledger = attached(&entry);
  return ledger == NULL ? 0 : atomic_load(&ledger->header.watch_matches);
}

/* Whether the reader has to know of it. */
static bool sample(struct ledger_endpoint *endpoint, uint32_t slot, uint32_t watch) {
  size_t others = 0;
  count_matched *count = counts[asked[slot].kind];
  if (count == NULL) return false;
  if (count(asked[slot].address, &others) != 0) {
    /* Asked again it would refuse again, with a line on stderr each time. */
    asked[slot].address = NULL;
    return atomic_exchange(&endpoint->matched, 0) != 0;
  }
  uint64_t most = others < UINT32_MAX ? others : UINT32_MAX;
  uint64_t matched = (uint64_t)watch << 32 | most;
  return atomic_exchange(&endpoint->matched, matched) != matched;
}

static void find_counts(void) {
  for (int kind = KIND_SUBSCRIPTION; kind <= KIND_PUBLISHER; kind++)
    if (counts[kind] == NULL)
      counts[kind] = (count_matched *)next_function(names[kind], "librmw_implementation.so");
}

/* Under the lock. */
static void sample_all(void) {
  bool news = false;
  uint32_t entry;
  struct ledger *ledger = attached(&entry);
  uint32_t watch = ledger == NULL ? 0 : atomic_load(&ledger->header.watch_matches);
  if (watch == 0) return;
  find_counts();
  for (uint32_t slot = 0; slot < used; slot++) {
    if (asked[slot].address != NULL) news |= sample(&ledger->endpoint[slot], slot, watch);
  }
  if (news) changed(ledger, EVENT_MATCHED);
}

void matches_sample(void) {
  if (atomic_exchange(&sampling, true)) return;
  int kept = errno;
  pthread_mutex_lock(&attach_lock);
  sample_all();
  pthread_mutex_unlock(&attach_lock);
  errno = kept;
  atomic_store(&sampling, false);
}
