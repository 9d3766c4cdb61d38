/* The signs that publishers give of themselves whose liveliness is manual: whoever recorded them had
 * publishers that gave some, also while they published nothing. */
#define _GNU_SOURCE
#include <stdint.h>
#include <time.h>

#include "player.h"

#define IN_A_LEASE 4
/* No pause is shorter, however short the lease, and none longer: the next publisher may have a shorter lease. */
#define LEAST_NS 1000000u
#define MOST_NS 20000000u

static _Atomic bool shown[PLAYER_ENDPOINTS];
static _Atomic uint64_t pause_ns = MOST_NS;

static void *show_all(void *unused) {
  (void)unused;
  while (!atomic_load(&ending)) {
    for (uint32_t slot = 0; slot < PLAYER_ENDPOINTS; slot++)
      if (atomic_load(&shown[slot])) publisher_show(slot);
    struct timespec pause = {0, (long)atomic_load(&pause_ns)};
    nanosleep(&pause, NULL);
  }
  thread_ends();
  return NULL;
}

bool presence_add(uint32_t slot, const struct qos *qos) {
  static bool started; /* by the only thread that makes publishers */
  if (!qos->manual || qos->lease == 0) return true;
  uint64_t pause = qos->lease / IN_A_LEASE;
  if (pause < LEAST_NS) pause = LEAST_NS;
  if (pause < atomic_load(&pause_ns)) atomic_store(&pause_ns, pause);
  publisher_show(slot);
  atomic_store(&shown[slot], true);
  if (!started) started = thread_start(show_all);
  return started;
}
