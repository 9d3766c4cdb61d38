/* The tracepoints of libtracetools.so, which rcl and rclcpp call whether or not somebody traces. */
#include <stdbool.h>
#include <stddef.h>

#include "count.h"
#include "interpose.h"
#include "list.h"

#define NEXT_TRACE(name) NEXT(name, "libtracetools.so", )

PUBLIC void ros_trace_rcl_subscription_init(const void *rcl, const void *node, const void *rmw,
                                            const char *topic, size_t depth) {
  list_link(rmw, rcl, 0);
  NEXT_TRACE(ros_trace_rcl_subscription_init)
  next(rcl, node, rmw, topic, depth);
}

PUBLIC void ros_trace_rclcpp_subscription_init(const void *rcl, const void *subscription) {
  list_introduced(rcl, subscription);
  NEXT_TRACE(ros_trace_rclcpp_subscription_init)
  next(rcl, subscription);
}

PUBLIC void ros_trace_rclcpp_subscription_callback_added(const void *subscription,
                                                         const void *callback) {
  list_callback(subscription, callback);
  NEXT_TRACE(ros_trace_rclcpp_subscription_callback_added)
  next(subscription, callback);
}

PUBLIC void ros_trace_callback_start(const void *callback, bool intra) {
  count_start(callback, intra);
  NEXT_TRACE(ros_trace_callback_start)
  next(callback, intra);
}

PUBLIC void ros_trace_callback_end(const void *callback) {
  count_end(callback);
  NEXT_TRACE(ros_trace_callback_end)
  next(callback);
}
