/* Guard conditions and wait sets. */
#define _GNU_SOURCE
#include <stdlib.h>
#include <string.h>

#include "rmw_parts.h"

struct guard {
  dds_entity_t entity;
};

struct wait_set {
  dds_entity_t entity;
  dds_entity_t attached[MOST_ENTITIES];
  size_t count;
};

struct rmw_guard *rmw_create_guard_condition(struct rmw_context *context) {
  struct rmw_guard *made = calloc(1, sizeof *made);
  struct guard *guard = calloc(1, sizeof *guard);
  guard->entity = dds_create_guardcondition(DDS_CYCLONEDDS_HANDLE);
  *made = (struct rmw_guard){IDENTIFIER, guard, context};
  return made;
}

int rmw_destroy_guard_condition(struct rmw_guard *guard) {
  dds_delete(((struct guard *)guard->data)->entity);
  free(guard->data);
  free(guard);
  return RMW_OK;
}

int rmw_trigger_guard_condition(const struct rmw_guard *guard) {
  dds_set_guardcondition(((const struct guard *)guard->data)->entity, true);
  return RMW_OK;
}

struct rmw_wait_set *rmw_create_wait_set(struct rmw_context *context, size_t most) {
  (void)context, (void)most;
  struct rmw_wait_set *made = calloc(1, sizeof *made);
  struct wait_set *set = calloc(1, sizeof *set);
  set->entity = dds_create_waitset(DDS_CYCLONEDDS_HANDLE);
  *made = (struct rmw_wait_set){IDENTIFIER, NULL, set};
  return made;
}

int rmw_destroy_wait_set(struct rmw_wait_set *set) {
  dds_delete(((struct wait_set *)set->data)->entity);
  free(set->data);
  free(set);
  return RMW_OK;
}

/* Has a set wait for these and no others; most often they are those of the last time. */
static void attach(struct wait_set *set, const dds_entity_t *wanted, size_t count) {
  if (count == set->count && memcmp(wanted, set->attached, count * sizeof *wanted) == 0) return;
  for (size_t one = 0; one < set->count; one++)
    dds_waitset_detach(set->entity, set->attached[one]);
  for (size_t one = 0; one < count; one++) dds_waitset_attach(set->entity, wanted[one], 0);
  memcpy(set->attached, wanted, count * sizeof *wanted);
  set->count = count;
}

static dds_duration_t duration(const struct rmw_time *timeout) {
  if (timeout == NULL || timeout->seconds > INT64_MAX / DDS_NSECS_IN_SEC - 1) return DDS_INFINITY;
  return DDS_SECS((int64_t)timeout->seconds) + (int64_t)timeout->nanoseconds;
}

static void nothing_of(struct rmw_things *of) {
  for (size_t one = 0; of != NULL && one < of->count; one++) of->things[one] = NULL;
}

int rmw_wait(struct rmw_things *subscriptions, struct rmw_things *guards,
             struct rmw_things *services, struct rmw_things *clients, struct rmw_things *events,
             struct rmw_wait_set *wait_set, const struct rmw_time *timeout) {
  struct wait_set *set = wait_set->data;
  dds_entity_t wanted[MOST_ENTITIES];
  size_t count = 0, ready = 0;
  for (size_t one = 0; subscriptions != NULL && one < subscriptions->count; one++)
    wanted[count++] = ((struct endpoint *)subscriptions->things[one])->condition;
  for (size_t one = 0; guards != NULL && one < guards->count; one++)
    wanted[count++] = ((struct guard *)guards->things[one])->entity;
  attach(set, wanted, count);
  dds_waitset_wait(set->entity, NULL, 0, duration(timeout));
  count = 0;
  for (size_t one = 0; subscriptions != NULL && one < subscriptions->count; one++) {
    bool now = dds_triggered(wanted[count++]) > 0;
    if (!now) subscriptions->things[one] = NULL;
    ready += now;
  }
  for (size_t one = 0; guards != NULL && one < guards->count; one++) {
    bool now = false;
    dds_take_guardcondition(wanted[count++], &now);
    if (!now) guards->things[one] = NULL;
    ready += now;
  }
  nothing_of(services);
  nothing_of(clients);
  nothing_of(events);
  return ready > 0 ? RMW_OK : RMW_TIMEOUT;
}
