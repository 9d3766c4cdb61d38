/* The states of nodes with a life cycle, by a client of librcl for each. A question is taken on step
 * by step, so that a node that is slow to answer keeps nobody waiting. */
#define _GNU_SOURCE
#include <stdio.h>
#include <string.h>
#include <time.h>

#include "layout.h"
#include "rcl.h"

#define PACKAGE "lifecycle_msgs"
#define TYPES "lib" PACKAGE "__rosidl_typesupport_c.so"
#define STRUCTURES "lib" PACKAGE "__rosidl_generator_c.so"
/* What is not answered for so long is asked again: who had it may have ended. */
#define PATIENCE_S 2
#define ROUND 32 /* answers that are looked at in a step */

/* rmw_request_id_t */
struct request_id {
  uint8_t writer[16];
  int64_t sequence;
};

static struct question {
  struct blob client;
  bool made, waits;
  int64_t sequence; /* of what was asked last */
  time_t asked;
} questions[PLAYER_STATES];

/* GetState's handle, and the structure that an answer is taken into: it begins with the state. */
static const void *type;
static uint8_t *response;

static bool load(struct answer *into) {
  if (response != NULL) return true;
  const void *(*get)(void) = (const void *(*)(void))rcl_function(
      TYPES, "rosidl_typesupport_c__get_service_type_support_handle__" PACKAGE "__srv__GetState",
      into);
  if (get == NULL) return false;
  void *(*create)(void) = (void *(*)(void))rcl_function(
      STRUCTURES, PACKAGE "__srv__GetState_Response__create", into);
  if (create == NULL) return false;
  type = get();
  response = create();
  if (response == NULL) answer_failed(into, STATUS_REQUEST, "there is no memory for an answer");
  return response != NULL;
}

static bool prepare(struct question *of, const char *name, struct answer *into) {
  if (of->made) return true;
  char service[512];
  snprintf(service, sizeof service, "%.480s/get_state", name);
  struct blob options = rcl.rcl_client_get_default_options();
  memset(&of->client, 0, sizeof of->client);
  int failed = rcl.rcl_client_init(&of->client, &node, type, service, &options);
  if (failed) answer_rcl(into, "rcl_client_init", failed);
  of->made = !failed;
  return of->made;
}

static time_t now(void) {
  struct timespec now;
  clock_gettime(CLOCK_MONOTONIC, &now);
  return now.tv_sec;
}

/* Takes the answer to what was asked last; those to earlier questions are passed over. */
static bool take(struct question *of, uint32_t *state) {
  for (int round = 0; round < ROUND; round++) {
    struct request_id id = {.sequence = 0};
    if (rcl.rcl_take_response(&of->client, &id, response) != RCL_OK) {
      rcl.rcutils_reset_error();
      return false;
    }
    if (id.sequence != of->sequence) continue;
    *state = response[0];
    return true;
  }
  return false;
}

static enum asked step(struct question *of, uint32_t *state) {
  bool there = false;
  if (of->waits && take(of, state)) {
    of->waits = false;
    return ASKED_ANSWERED;
  }
  if (rcl.rcl_service_server_is_available(&node, &of->client, &there) != RCL_OK) there = false;
  if (!there) {
    rcl.rcutils_reset_error();
    of->waits = false;
    return ASKED_NOBODY;
  }
  if (of->waits && now() - of->asked < PATIENCE_S) return ASKED_BEFORE;
  static const uint8_t request[16]; /* it says nothing */
  of->waits = rcl.rcl_send_request(&of->client, request, &of->sequence) == RCL_OK;
  of->asked = now();
  if (!of->waits) rcl.rcutils_reset_error();
  return of->waits ? ASKED_NOW : ASKED_NOBODY;
}

void node_state(uint32_t number, const char *name, struct answer *into) {
  struct question *of = &questions[number];
  if (!load(into) || !prepare(of, name, into)) return;
  uint32_t state = 0;
  enum asked asked = step(of, &state);
  answer_number(into, STATUS_DONE);
  answer_number(into, asked);
  answer_number(into, state);
}

void states_leave(void) {
  for (uint32_t one = 0; one < PLAYER_STATES; one++)
    if (questions[one].made) (void)!rcl.rcl_client_fini(&questions[one].client, &node);
}
