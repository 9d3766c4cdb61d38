/* Timers: as far as they are called and have a clock. */
#include "rcl_timer.h"

#include "rcl.h"

int rcl_timer_clock(struct rcl_timer *timer, struct rcl_clock **clock) {
  *clock = timer->clock;
  return RCL_OK;
}

int rcl_is_enabled_ros_time_override(struct rcl_clock *clock, bool *enabled) {
  *enabled = clock->simulated;
  return clock->type == CLOCK_ROS_TIME ? RCL_OK : RCL_ERROR;
}

int rcl_timer_call(struct rcl_timer *timer) { return timer->clock == NULL ? RCL_ERROR : RCL_OK; }
