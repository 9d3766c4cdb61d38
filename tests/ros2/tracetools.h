/* The stand-in's libtracetools.so. */
#pragma once
#include <stdbool.h>
#include <stddef.h>

void ros_trace_rcl_subscription_init(const void *rcl, const void *node, const void *rmw,
                                     const char *topic, size_t depth);
void ros_trace_rclcpp_subscription_init(const void *rcl, const void *subscription);
void ros_trace_rclcpp_subscription_callback_added(const void *subscription, const void *callback);
void ros_trace_callback_start(const void *callback, bool intra);
void ros_trace_callback_end(const void *callback);
