/* What the parts of the program have in common. */
#pragma once
#include "answer.h"
#include "rcl.h"
#include "ring.h"

extern struct blob context, node;

/* What both kinds of endpoint are made from. */
struct wanted {
  uint32_t slot;
  const void *type;
  const char *topic;
  struct qos qos;
  bool others; /* a subscription: to what other programs publish alone */
};

/* Sets the head of the options of a publisher or a subscription. */
void qos_into(struct blob *options, const struct qos *qos);

/* start.c: loads ROS 2 and makes the node. Each of these has answered when it returns. */
void start(struct request *from, struct answer *into);
/* Starts a thread of the program, which is counted until it returns. */
bool thread_start(void *(*body)(void *));
void thread_ends(void);
/* Ends all of it, within a second whatever hangs. */
_Noreturn void end(int control_socket);

/* control.c: a thread that answers requests until the socket closes. */
extern int control_socket;
void *control(void *unused);

/* publish.c: a thread that publishes what comes by the ring. */
void *publish_all(void *unused);
void publisher_add(const struct wanted *wanted, struct answer *into);
void publisher_matched(uint32_t slot, struct answer *into);
void publisher_refusal(uint32_t slot, struct answer *into);
void publishers_end(void);

/* take.c: a thread that takes what subscriptions receive. */
bool take_prepare(struct answer *into);
void *take_all(void *unused);
void subscription_add(const struct wanted *wanted, struct answer *into);
void subscription_matched(uint32_t slot, struct answer *into);
void take_wake(void);
void subscriptions_end(void);

/* graph.c */
void graph(struct answer *into);
