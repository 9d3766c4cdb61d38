#include "origin.h"

#include <errno.h>
#include <stdbool.h>
#include <stddef.h>
#include <string.h>

#include "attach.h"
#include "cyclone.h"

/* Publishers of which the key is kept; beyond, it is asked for at each message. */
#define HANDLES 1024u

/* FNV-1a, as the reader has it (src/own.rs). No key is 0. */
static uint64_t key_of(const uint8_t gid[16]) {
  uint64_t key = 0xcbf29ce484222325ull;
  for (int byte = 0; byte < 16; byte++) key = (key ^ gid[byte]) * 0x100000001b3ull;
  return key == 0 ? 1 : key;
}

static bool is_own(struct ledger *ledger, uint64_t key) {
  for (uint32_t step = 0; step < LEDGER_OWN; step++) {
    uint64_t found = atomic_load(&ledger->own[(key + step) % LEDGER_OWN]);
    if (found == key) return true;
    if (found == 0) return false;
  }
  return false;
}

/* How the C library of Cyclone DDS describes a publisher. */
struct publication {
  uint8_t guid[16];
};
typedef struct publication *get_publication(int32_t reader, uint64_t handle);
typedef void free_publication(struct publication *);

static struct {
  _Atomic uint64_t handle; /* 0: free */
  _Atomic uint64_t key;    /* 0: not known yet */
} known[HANDLES];

/* 0 if the middleware does not know it, as when the publisher has left. */
static uint64_t ask(int32_t reader, uint64_t handle) {
  static get_publication *_Atomic getter;
  static free_publication *_Atomic freer;
  get_publication *get = atomic_load(&getter);
  free_publication *give_back = atomic_load(&freer);
  if (get == NULL || give_back == NULL) {
    get = (get_publication *)cyclone_function("dds_get_matched_publication_data");
    give_back = (free_publication *)cyclone_function("dds_builtintopic_free_endpoint");
    if (get == NULL || give_back == NULL) return 0;
    atomic_store(&getter, get);
    atomic_store(&freer, give_back);
  }
  struct publication *found = get(reader, handle);
  if (found == NULL) return 0;
  uint64_t key = key_of(found->guid);
  give_back(found);
  return key;
}

/* No entry is given to another handle, so that what is read of one belongs together. */
static uint64_t key_of_handle(int32_t reader, uint64_t handle) {
  if (handle == 0) return 0;
  for (uint32_t step = 0; step < HANDLES; step++) {
    uint32_t at = (uint32_t)((handle + step) % HANDLES);
    uint64_t has = atomic_load(&known[at].handle);
    if (has == handle) {
      uint64_t key = atomic_load(&known[at].key);
      return key != 0 ? key : ask(reader, handle);
    }
    if (has != 0) continue;
    uint64_t key = ask(reader, handle);
    if (key != 0 && atomic_compare_exchange_strong(&known[at].handle, &has, handle))
      atomic_store(&known[at].key, key);
    return key;
  }
  return ask(reader, handle);
}

void origin_forget(void) { memset(known, 0, sizeof known); }

/* rmw_cyclonedds gives a message the handle that this process has of its publisher. Only the middleware
 * knows which publisher that is; of what is no entity of its, none. */
static uint64_t key_in_cyclone(const struct endpoint_head *subscription,
                               const struct message_info *info) {
  int32_t reader;
  uint64_t handle;
  if (!cyclone_entity(subscription, &reader)) return 0;
  memcpy(&handle, info->gid, sizeof handle);
  return key_of_handle(reader, handle);
}

static enum origin_of_message whose(struct ledger *ledger, const struct endpoint_head *subscription,
                                    const struct message_info *info) {
  uint64_t key = is_cyclone(info->implementation) ? key_in_cyclone(subscription, info) : key_of(info->gid);
  if (key == 0) return ORIGIN_UNKNOWN;
  return is_own(ledger, key) ? ORIGIN_OWN : ORIGIN_OTHER;
}

struct origin origin_of(const struct endpoint_head *subscription, const struct message_info *info) {
  struct origin origin = {ORIGIN_UNKNOWN, 0};
  uint32_t entry;
  struct ledger *ledger = attached(&entry);
  /* The same text at the same place: otherwise it begins in another way. */
  bool says = ledger != NULL && info != NULL && info->implementation != NULL &&
              info->implementation == subscription->implementation;
  if (!says) return origin;
  int kept = errno;
  origin.whose = whose(ledger, subscription, info);
  origin.stamp = info->source;
  errno = kept;
  return origin;
}
