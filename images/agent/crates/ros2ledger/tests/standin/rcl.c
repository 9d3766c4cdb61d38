/* librcl.so of the stand-in: timers, as far as they are called and have a clock. */
#include "rcl.h"

int rcl_timer_clock(struct rcl_timer *timer, struct rcl_clock **clock) {
  *clock = timer->clock;
  return 0;
}

int rcl_is_enabled_ros_time_override(struct rcl_clock *clock, bool *enabled) {
  *enabled = clock->simulated;
  return clock->type == CLOCK_ROS_TIME ? 0 : 1;
}

int rcl_timer_call_with_info(struct rcl_timer *timer, struct rcl_timer_info *info) {
  info->calls = ++timer->calls;
  return timer->cancelled ? 800 : 0;
}

/* As in Jazzy, where one calls the other. */
int rcl_timer_call(struct rcl_timer *timer) {
  struct rcl_timer_info info;
  return rcl_timer_call_with_info(timer, &info);
}
