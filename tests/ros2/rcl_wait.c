/* Guard conditions and wait sets of rcl. */
#include <stdlib.h>
#include <string.h>

#include "rcl.h"

struct rcl_waiting {
  size_t subscriptions, guards; /* that were added */
  void **of_subscriptions, **of_guards;
  struct rmw_wait_set *rmw;
};

int rcl_guard_condition_init(struct rcl_guard *guard, struct rcl_context *context,
                             struct rcl_guard_options options) {
  if (options.allocator.allocate == NULL)
    return standin_error(RCL_INVALID_ARGUMENT, "the guard condition has no allocator");
  guard->impl = rmw_create_guard_condition(context->impl);
  guard->context = context;
  return RCL_OK;
}

int rcl_guard_condition_fini(struct rcl_guard *guard) {
  return rmw_destroy_guard_condition(guard->impl);
}

int rcl_trigger_guard_condition(struct rcl_guard *guard) {
  return rmw_trigger_guard_condition(guard->impl);
}

int rcl_wait_set_init(struct rcl_wait_set *set, size_t subscriptions, size_t guards, size_t timers,
                      size_t clients, size_t services, size_t events, struct rcl_context *context,
                      struct allocator allocator) {
  if (set->impl != NULL || timers + clients + services + events > 0 || allocator.allocate == NULL)
    return standin_error(RCL_INVALID_ARGUMENT, "the wait set is initialized, or not as it should");
  memset(set, 0, sizeof *set);
  set->subscriptions = calloc(subscriptions + 1, sizeof *set->subscriptions);
  set->subscription_count = subscriptions;
  set->guards = calloc(guards + 1, sizeof *set->guards);
  set->guard_count = guards;
  set->impl = calloc(1, sizeof *set->impl);
  set->impl->of_subscriptions = calloc(subscriptions + 1, sizeof(void *));
  set->impl->of_guards = calloc(guards + 1, sizeof(void *));
  set->impl->rmw = rmw_create_wait_set(context->impl, subscriptions + guards);
  return RCL_OK;
}

int rcl_wait_set_fini(struct rcl_wait_set *set) {
  rmw_destroy_wait_set(set->impl->rmw);
  free(set->impl->of_subscriptions);
  free(set->impl->of_guards);
  free(set->impl);
  free(set->subscriptions);
  free(set->guards);
  memset(set, 0, sizeof *set);
  return RCL_OK;
}

int rcl_wait_set_clear(struct rcl_wait_set *set) {
  set->impl->subscriptions = set->impl->guards = 0;
  memset(set->subscriptions, 0, set->subscription_count * sizeof *set->subscriptions);
  memset(set->guards, 0, set->guard_count * sizeof *set->guards);
  return RCL_OK;
}

int rcl_wait_set_add_subscription(struct rcl_wait_set *set, const struct rcl_endpoint *one,
                                  size_t *index) {
  size_t at = set->impl->subscriptions++;
  if (at >= set->subscription_count) return standin_error(RCL_WAIT_SET_FULL, "it is full");
  set->subscriptions[at] = one;
  if (index != NULL) *index = at;
  return RCL_OK;
}

int rcl_wait_set_add_guard_condition(struct rcl_wait_set *set, const struct rcl_guard *one,
                                     size_t *index) {
  size_t at = set->impl->guards++;
  if (at >= set->guard_count) return standin_error(RCL_WAIT_SET_FULL, "it is full");
  set->guards[at] = one;
  if (index != NULL) *index = at;
  return RCL_OK;
}

int rcl_wait(struct rcl_wait_set *set, int64_t nanoseconds) {
  struct rcl_waiting *of = set->impl;
  if (of->subscriptions + of->guards == 0)
    return standin_error(RCL_WAIT_SET_EMPTY, "nothing is waited for");
  for (size_t one = 0; one < of->subscriptions; one++)
    of->of_subscriptions[one] = set->subscriptions[one]->impl->data;
  for (size_t one = 0; one < of->guards; one++)
    of->of_guards[one] = set->guards[one]->impl->data;
  struct rmw_things subscriptions = {of->subscriptions, of->of_subscriptions};
  struct rmw_things guards = {of->guards, of->of_guards};
  struct rmw_time timeout = {(uint64_t)nanoseconds / 1000000000, (uint64_t)nanoseconds % 1000000000};
  int returned = rmw_wait(&subscriptions, &guards, NULL, NULL, NULL, of->rmw,
                          nanoseconds < 0 ? NULL : &timeout);
  for (size_t one = 0; one < of->subscriptions; one++)
    if (of->of_subscriptions[one] == NULL) set->subscriptions[one] = NULL;
  for (size_t one = 0; one < of->guards; one++)
    if (of->of_guards[one] == NULL) set->guards[one] = NULL;
  return returned;
}
