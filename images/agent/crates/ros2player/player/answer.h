/* Requests and answers, as the crate's documentation has them (src/control.rs is the other end). */
#pragma once
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define REQUEST_MOST (1u << 20) /* bytes */
#define ANSWER_MOST (1u << 24)

enum verb {
  VERB_START,       /* name and namespace of the node */
  VERB_ADVERTISE,   /* slot; topic, package, folder, type; history, depth, reliability, durability */
  VERB_SUBSCRIBE,   /* as above */
  VERB_SUBSCRIBERS, /* a publisher's slot; u64: how many it has matched */
  VERB_PUBLISHERS,  /* a subscription's slot; as above */
  VERB_GRAPH,       /* nodes: namespace, name, what it publishes, what it subscribes to */
  VERB_REFUSAL,     /* a publisher's slot; text: why its last message was refused */
  VERB_LISTEN,      /* as to subscribe, but to what this program publishes itself */
  VERB_STATE,       /* a number below PLAYER_STATES, which is the node's from then on; its name; u32:
                     * how far it is (enum asked); u32: the state */
  VERB_TOPICS,      /* topics, whichever nodes have them: name; u32: how many types it has, with librcl those of
                     * subscriptions among them; the first */
  VERB_TOPIC,       /* a topic; u32: how many publishers; of each: namespace and name of its node, which are not
                     * those of a node where the graph has none; its type; its gid */
};

/* How far the question for a node's state is; each request takes it on by a step. */
enum asked {
  ASKED_NOBODY,  /* there is no such service */
  ASKED_NOW,     /* by this request */
  ASKED_BEFORE,  /* by an earlier one, and it is not answered yet */
  ASKED_ANSWERED /* what was asked last, by the state that follows */
};

enum status {
  STATUS_DONE,
  STATUS_LIBRARY, /* text: why there is no librcl */
  STATUS_SYMBOL,  /* text: the function that it lacks */
  STATUS_PACKAGE, /* text: the library of types; text: why it is not to be had */
  STATUS_TYPE,    /* text: the library of types, which lacks this one */
  STATUS_CALL,    /* text: the middleware's function; u32: what it returned; text: its reason */
  STATUS_REQUEST, /* text: what is wrong with it */
};

/* A request: what is read beyond its end is 0 or "", and `wrong` afterwards. */
struct request {
  const uint8_t *bytes;
  size_t length, at;
  bool wrong;
};

uint32_t request_number(struct request *from);
const char *request_text(struct request *from);

/* An answer that grows. */
struct answer {
  uint8_t *bytes;
  size_t length, capacity;
};

/* Forgets what stands in it; the head is written by `answer_send`. */
void answer_begin(struct answer *into);
void answer_number(struct answer *into, uint32_t number);
void answer_long(struct answer *into, uint64_t number);
void answer_text(struct answer *into, const char *text);
/* u32: whether it is known; two u64, which have its 16 bytes. NULL: it is not. */
void answer_gid(struct answer *into, const uint8_t *gid);

/* Makes it one that begins with a status. */
void answer_failed(struct answer *into, enum status status, const char *text);

/* Makes it that a function of the middleware has failed, with its reason. */
void answer_call(struct answer *into, const char *function, int returned, const char *reason);

/* Sends it as the answer to a request; false if nobody receives it. */
bool answer_send(struct answer *from, int socket, uint32_t sequence);
