/* A life cycle as rcl_lifecycle's: the state is served, and each transition published. */
#define _GNU_SOURCE
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "node.h"

#define LOOK_US 2000

static struct publisher events;
static struct rmw_service *service;
static pthread_t serving;
static pthread_mutex_t turning = PTHREAD_MUTEX_INITIALIZER;
static _Atomic int state;
static _Atomic bool over;

/* A number with an empty text, behind what stands there; where the next one begins. */
static size_t put(uint8_t *bytes, size_t at, int number) {
  size_t length = at / 4 * 4 + 4; /* aligned, as numbers of one byte are not */
  bytes[at] = (uint8_t)number;
  bytes[length] = 1;
  return length + 5;
}

static void enter(int next) {
  uint8_t bytes[64] = {0, 1, 0, 0};
  size_t at = 4 + 8; /* the stamp is left out, as rcl_lifecycle does */
  at = put(bytes, at, 0);
  at = put(bytes, at, state);
  at = put(bytes, at, next);
  state = next;
  publish(&events, bytes, (at + 3) / 4 * 4);
}

void life_turns(void) {
  if (asked.life == 0) return;
  pthread_mutex_lock(&turning);
  bool active = state == ACTIVE;
  enter(active ? DEACTIVATING : ACTIVATING);
  enter(active ? INACTIVE : ACTIVE);
  pthread_mutex_unlock(&turning);
}

static void *serve_state(void *unused) {
  (void)unused;
  while (!over) {
    struct rmw_service_info info;
    bool taken = false;
    rmw_take_request(service, &info, NULL, &taken);
    if (!taken) {
      sleep_us(LOOK_US);
      continue;
    }
    struct get_state_response response = {.id = (uint8_t)state};
    rmw_send_response(service, &info.id, &response);
  }
  return NULL;
}

void life_begins(void) {
  if (asked.life == 0) return;
  char topic[600], name[600];
  const char *space = strcmp(asked.space, "/") == 0 ? "" : asked.space;
  snprintf(topic, sizeof topic, "%s/%s/transition_event", space, asked.name);
  snprintf(name, sizeof name, "%s/%s/get_state", space, asked.name);
  struct rmw_qos qos = {.history = HISTORY_KEEP_LAST, .depth = 10,
                        .reliability = RELIABILITY_RELIABLE, .durability = DURABILITY_VOLATILE};
  state = asked.life;
  events.rmw = rmw_create_publisher(
      node, message_type("lifecycle_msgs", "msg", "TransitionEvent"), topic, &qos, NULL);
  service = rmw_create_service(node, service_type("lifecycle_msgs", "GetState"), name, &qos);
  if (events.rmw == NULL || service == NULL) {
    fprintf(stderr, "standin_node: no life cycle: %s\n", rcutils_get_error_string().str);
    exit(1);
  }
  pthread_create(&serving, NULL, serve_state, NULL);
}

void life_ends(void) {
  if (asked.life == 0) return;
  over = true;
  pthread_join(serving, NULL);
  rmw_destroy_service(node, service);
  rmw_destroy_publisher(node, events.rmw);
}
