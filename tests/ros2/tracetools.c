/* Nobody traces. */
#include "tracetools.h"

void ros_trace_rcl_subscription_init(const void *rcl, const void *node, const void *rmw,
                                     const char *topic, size_t depth) {
  (void)rcl, (void)node, (void)rmw, (void)topic, (void)depth;
}

void ros_trace_rclcpp_subscription_init(const void *rcl, const void *subscription) {
  (void)rcl, (void)subscription;
}

void ros_trace_rclcpp_subscription_callback_added(const void *subscription, const void *callback) {
  (void)subscription, (void)callback;
}

void ros_trace_callback_start(const void *callback, bool intra) { (void)callback, (void)intra; }

void ros_trace_callback_end(const void *callback) { (void)callback; }
