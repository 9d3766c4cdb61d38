/* Timers of librcl.so: which of them go by the machine's clock, whatever time the stack is shown. The
 * same functions from Foxy to Rolling, but the one with more to fill in, which came with Jazzy. */
#include <stdbool.h>
#include <stddef.h>

#include "count.h"
#include "interpose.h"

#define RCL "librcl.so"
#define RCL_OK 0
#define RCL_ERROR 1
#define CLOCK_ROS_TIME 1

/* What rcl_clock_t begins with. */
struct clock_head {
  int type;
};

int rcl_timer_clock(const void *timer, struct clock_head **clock);
int rcl_is_enabled_ros_time_override(struct clock_head *clock, bool *enabled);

/* One of the two calls the other in some releases. */
static __thread unsigned inside __attribute__((tls_model("initial-exec")));

static struct clock_head *clock_of(const void *timer) {
  struct clock_head *clock = NULL;
  NEXT(rcl_timer_clock, RCL, NULL)
  return next(timer, &clock) == RCL_OK ? clock : NULL;
}

/* ROS' time is the machine's until somebody simulates it. */
static bool is_simulated(struct clock_head *clock) {
  bool enabled = false;
  NEXT(rcl_is_enabled_ros_time_override, RCL, false)
  return clock->type == CLOCK_ROS_TIME && next(clock, &enabled) == RCL_OK && enabled;
}

/* Once one has been called: of one that was cancelled meanwhile nothing comes. */
static void count_call(const void *timer, int result) {
  if (--inside > 0 || result != RCL_OK) return;
  struct clock_head *clock = clock_of(timer);
  if (clock != NULL && !is_simulated(clock)) count_machine_timer();
}

PUBLIC int rcl_timer_call(void *timer) {
  NEXT(rcl_timer_call, RCL, RCL_ERROR)
  inside++;
  int result = next(timer);
  count_call(timer, result);
  return result;
}

PUBLIC int rcl_timer_call_with_info(void *timer, void *info) {
  NEXT(rcl_timer_call_with_info, RCL, RCL_ERROR)
  inside++;
  int result = next(timer, info);
  count_call(timer, result);
  return result;
}
