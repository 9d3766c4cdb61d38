#include "handles.h"

#include <string.h>

#define HANDLES 4096u
#define TRIES 64u /* places that one may have: a table that is full costs no more */

static struct {
  uint64_t handle; /* 0: free */
  uint8_t guid[GID_BYTES];
} known[HANDLES];

bool handle_known(uint64_t handle, uint8_t guid[GID_BYTES]) {
  for (uint32_t step = 0; step < TRIES; step++) {
    uint32_t at = (uint32_t)((handle + step) % HANDLES);
    if (known[at].handle == 0) return false;
    if (known[at].handle != handle) continue;
    memcpy(guid, known[at].guid, GID_BYTES);
    return true;
  }
  return false;
}

void handle_keep(uint64_t handle, const uint8_t guid[GID_BYTES]) {
  for (uint32_t step = 0; step < TRIES; step++) {
    uint32_t at = (uint32_t)((handle + step) % HANDLES);
    if (known[at].handle != 0) continue;
    memcpy(known[at].guid, guid, GID_BYTES);
    known[at].handle = handle;
    return;
  }
}
