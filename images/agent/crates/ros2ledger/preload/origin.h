/* Who published a message that was taken. */
#pragma once
#include <stdint.h>

#include "list.h"

/* How rmw_message_info_t begins, from Galactic on. */
struct message_info {
  int64_t source, received;
  uint64_t publication, reception;
  const char *implementation;
  uint8_t gid[16];
};

enum origin_of_message {
  ORIGIN_UNKNOWN, /* the middleware does not say */
  ORIGIN_OWN,     /* a publisher of the ledger's reader */
  ORIGIN_OTHER,
};

struct origin {
  enum origin_of_message whose;
  int64_t stamp; /* the source's, in ns since 1970 */
};

/* Without `info` it is not to be known. Takes no lock of the ledger's, and of the middleware's one at a
 * publisher's first message. Does not change errno. */
struct origin origin_of(const struct endpoint_head *subscription, const struct message_info *info);
/* A child's middleware is another. */
void origin_forget(void);
