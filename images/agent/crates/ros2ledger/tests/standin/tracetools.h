/* The stand-in's tracepoints. */
#pragma once
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

void ros_trace_rcl_subscription_init(const void *rcl, const void *node, const void *rmw,
                                     const char *topic, size_t depth);
void ros_trace_rclcpp_subscription_init(const void *rcl, const void *subscription);
void ros_trace_rclcpp_subscription_callback_added(const void *subscription, const void *callback);
void ros_trace_callback_start(const void *callback, bool intra);
void ros_trace_callback_end(const void *callback);

/* What only the stand-in has: how often any of them was called. */
uint64_t standin_traced(void);
