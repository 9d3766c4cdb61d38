/* What is different between the players: rcl/ has it by the librcl of the user's image, dds/ by a DDS
 * of its own. Whatever takes an answer has answered when it fails. */
#pragma once
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "answer.h"
#include "layout.h"

#define REASON_MOST 512 /* bytes of a sentence, with its 0 */

/* Quality of service by rmw's numbers. */
struct qos {
  int history; /* 1 keep last, 2 keep all */
  size_t depth;
  int reliability; /* 1 reliable, 2 best effort */
  int durability;  /* 1 transient local, 2 volatile */
  uint64_t deadline, lease; /* ns; 0: without end */
  bool manual; /* it shows by itself that it is there */
};

/* What both kinds of endpoint are made from. */
struct wanted {
  uint32_t slot;
  const char *topic, *package, *folder, *name; /* the last three: of its type */
  struct qos qos;
  bool others; /* a subscription: to what other programs publish alone */
};

/* A message, until the next take. */
struct taken {
  const uint8_t *bytes;
  size_t length;
  int64_t stamp; /* the source's, in ns since 1970 */
  uint8_t publisher[GID_BYTES]; /* its GID, as the graph has it; 0s where the middleware does not say */
};

enum took { TOOK_ONE, TOOK_NOTHING, TOOK_TROUBLE };

bool middleware_join(const char *name, const char *space, struct answer *into);
void middleware_leave(void);
void middleware_graph(struct answer *into);
void middleware_topics(struct answer *into);
void middleware_topic(const char *topic, struct answer *into);

bool publisher_make(const struct wanted *wanted, struct answer *into);
/* What a message's publisher is known by in the nodes that take it; false if the middleware does not
 * say. */
bool publisher_gid(uint32_t slot, uint8_t gid[GID_BYTES]);
bool publisher_count(uint32_t slot, uint64_t *matched, struct answer *into);
/* A sign that it is there, of one whose liveliness is manual. */
void publisher_show(uint32_t slot);
/* Where `more` of this publisher's follow at once, the message may be kept back until the last of them
 * has been sent: a datagram takes several. False, with the reason, if it is refused. */
bool publisher_send(uint32_t slot, const uint8_t *bytes, size_t length, bool more,
                    char reason[REASON_MOST]);
void publisher_unmake(uint32_t slot);

bool subscription_make(const struct wanted *wanted, struct answer *into);
bool subscription_count(uint32_t slot, uint64_t *matched, struct answer *into);
/* Of a trouble, `into->stamp` is its number. */
enum took subscription_take(uint32_t slot, struct taken *into, char reason[REASON_MOST]);
void subscription_unmake(uint32_t slot);

/* The state of a node with a life cycle, by its service. */
void node_state(uint32_t number, const char *name, struct answer *into);

/* Waits until some of these subscriptions have messages, somebody wakes it, or a moment is over.
 * False, with the reason, if it can't. */
bool messages_wait(const uint32_t *slots, size_t count, bool *ready, char reason[REASON_MOST]);
void messages_wake(void);
/* Nobody waits any more. */
void messages_leave(void);
