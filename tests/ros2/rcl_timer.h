/* Timers of the stand-in's librcl.so, with as much of the real structures as is read. */
#pragma once
#include <stdbool.h>

enum { CLOCK_ROS_TIME = 1, CLOCK_SYSTEM_TIME, CLOCK_STEADY_TIME };

struct rcl_clock {
  int type;
  bool simulated;
};
struct rcl_timer {
  struct rcl_clock *clock;
};

int rcl_timer_call(struct rcl_timer *timer);
