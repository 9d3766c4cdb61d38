/* Timers of the stand-in's librcl.so: structures are only as much of the real ones as is read. */
#pragma once
#include <stdbool.h>
#include <stdint.h>

enum { CLOCK_ROS_TIME = 1, CLOCK_SYSTEM_TIME, CLOCK_STEADY_TIME };

struct rcl_clock {
  int type;
  bool simulated;
};
struct rcl_timer {
  struct rcl_clock *clock;
  bool cancelled;
  uint64_t calls;
};
struct rcl_timer_info {
  uint64_t calls;
};

int rcl_timer_call(struct rcl_timer *timer);
int rcl_timer_call_with_info(struct rcl_timer *timer, struct rcl_timer_info *info);
