#include "matches.h"

#include <errno.h>
#include <stdbool.h>
#include <stddef.h>
#include <string.h>

#include "attach.h"
#include "next.h"

typedef int count_matched(const void *subscription, size_t *publishers);

/* All below is under the lock, so that nobody destroys a subscription while it is asked. */
static const void *subscriptions[LEDGER_ENDPOINTS];
static uint32_t used; /* slots beyond have none */

/* One thread of many that wait is enough. A lock that is only tried has a new version in new C
 * libraries. */
static _Atomic bool sampling;

void matches_of(uint32_t slot, const void *subscription) {
  subscriptions[slot] = subscription;
  if (subscription != NULL && used <= slot) used = slot + 1;
}

void matches_forget(void) {
  memset(subscriptions, 0, sizeof subscriptions);
  used = 0;
  atomic_store(&sampling, false); /* a child's parent may have been at it */
}

uint32_t matches_watched(void) {
  uint32_t entry;
  struct ledger *ledger = attached(&entry);
  return ledger == NULL ? 0 : atomic_load(&ledger->header.watch_matches);
}

/* Whether the reader has to know of it. */
static bool sample(struct ledger_endpoint *endpoint, uint32_t slot, uint32_t watch,
                   count_matched *count) {
  size_t publishers = 0;
  if (count(subscriptions[slot], &publishers) != 0) {
    /* Asked again it would refuse again, with a line on stderr each time. */
    subscriptions[slot] = NULL;
    return false;
  }
  uint64_t most = publishers < UINT32_MAX ? publishers : UINT32_MAX;
  uint64_t matched = (uint64_t)watch << 32 | most;
  return atomic_exchange(&endpoint->matched, matched) != matched;
}

/* Under the lock. */
static void sample_all(void) {
  static count_matched *count;
  bool news = false;
  uint32_t entry;
  if (count == NULL)
    count = (count_matched *)next_function("rmw_subscription_count_matched_publishers",
                                           "librmw_implementation.so");
  struct ledger *ledger = attached(&entry);
  uint32_t watch = ledger == NULL ? 0 : atomic_load(&ledger->header.watch_matches);
  for (uint32_t slot = 0; watch != 0 && count != NULL && slot < used; slot++) {
    if (subscriptions[slot] != NULL)
      news |= sample(&ledger->endpoint[slot], slot, watch, count);
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
