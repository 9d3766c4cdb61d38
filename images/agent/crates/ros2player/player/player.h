/* What the parts of the program have in common. */
#pragma once
#include "answer.h"
#include "middleware.h"
#include "ring.h"

/* threads.c: joins the graph. It has answered when it returns. */
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

/* presence.c: a publisher gives signs of itself from now on, if its liveliness is manual; false where no
 * thread is to be had. */
bool presence_add(uint32_t slot, const struct qos *qos);

/* take.c: a thread that takes what subscriptions receive. */
void *take_all(void *unused);
void subscription_add(const struct wanted *wanted, struct answer *into);
void subscription_matched(uint32_t slot, struct answer *into);
void subscriptions_end(void);
