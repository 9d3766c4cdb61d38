/* Counts what a process takes, calls and publishes. Without a ledger every function does nothing.
 * No function fails or changes errno. What counts takes no lock, so that a signal may interrupt it;
 * what creates, links and destroys does, as rmw itself does. */
#pragma once
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "layout.h"

/* How rmw_qos_profile_t begins, in every distribution. */
struct qos_head {
  int history;
  size_t depth;
  int reliability;
  int durability;
};

/* Lists a subscription or publisher under its rmw address. */
void count_listed(enum ledger_kind kind, const void *address, const char *topic,
                  const struct qos_head *qos);
/* The endpoint is about to be destroyed. */
void count_destroyed(const void *address);
/* `also` stands for what `known` stands for, with these flags from now on. */
void count_link(const void *known, const void *also, uint32_t flags);
/* A callback of an rclcpp subscription, which may be introduced only later. */
void count_callback(const void *subscription, const void *callback);
/* The rclcpp subscription of an rcl one. */
void count_introduced(const void *rcl, const void *subscription);

void count_take(const void *subscription, uint64_t messages);
void count_publish(const void *publisher);
/* This thread waits for work: what it took has been handled. */
void count_wait(void);
void count_start(const void *callback, bool intra);
void count_end(const void *callback);

/* Calls into rmw that are inside of another: only the outermost counts. */
void count_enter(void);
/* Whether the call that ends here was the outermost. */
bool count_leave(void);
