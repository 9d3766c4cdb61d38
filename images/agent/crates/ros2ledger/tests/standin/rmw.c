/* librmw_implementation.so of the stand-in: topics in the memory of one process, with queues of
 * KEEP_LAST that overwrite the oldest. */
#define _GNU_SOURCE
#include "rmw.h"

#include <arpa/inet.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#define SYSTEM_DEPTH 5 /* what this middleware gives who leaves it the depth */

struct endpoint {
  const char *implementation;
  void *data;
  const char *topic_name;
  char topic[512];
  struct qos qos;
  struct endpoint *next;
  uint64_t *queue, first, count, room, overwritten;
};

static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static pthread_cond_t arrived = PTHREAD_COND_INITIALIZER;
static struct endpoint *subscriptions, *publishers;

static uint16_t wire_port;
static size_t wire_bytes;

void standin_wire(uint16_t port, size_t bytes) {
  wire_port = port;
  wire_bytes = bytes;
}

static void enter(struct endpoint **list, struct endpoint *made) {
  pthread_mutex_lock(&lock);
  made->next = *list;
  *list = made;
  pthread_mutex_unlock(&lock);
}

static void leave(struct endpoint **list, const struct endpoint *gone) {
  pthread_mutex_lock(&lock);
  while (*list != NULL && *list != gone) list = &(*list)->next;
  if (*list != NULL) *list = gone->next;
  pthread_mutex_unlock(&lock);
}

static struct endpoint *make(const char *topic, const struct qos *qos) {
  struct endpoint *made = calloc(1, sizeof *made);
  made->implementation = "standin";
  made->data = made;
  made->topic_name = strncpy(made->topic, topic, sizeof made->topic - 1);
  made->qos = *qos;
  if (qos->history == 0) made->qos.history = 1;
  if (qos->reliability == 0) made->qos.reliability = 1;
  if (qos->durability == 0) made->qos.durability = 2;
  if (made->qos.history == 1 && qos->depth == 0) made->qos.depth = SYSTEM_DEPTH;
  made->room = made->qos.history == 1 ? made->qos.depth : 1u << 20;
  return made;
}

void *rmw_create_subscription(const void *node, const void *type, const char *topic,
                              const struct qos *qos, const void *options) {
  (void)node, (void)type, (void)options;
  struct endpoint *made = make(topic, qos);
  made->queue = calloc(made->room, sizeof *made->queue);
  enter(&subscriptions, made);
  return made;
}

void *rmw_create_publisher(const void *node, const void *type, const char *topic,
                           const struct qos *qos, const void *options) {
  (void)node, (void)type, (void)options;
  struct endpoint *made = make(topic, qos);
  if (wire_bytes > 0) made->implementation = "rmw_cyclonedds_cpp";
  enter(&publishers, made);
  return made;
}

int rmw_destroy_subscription(void *node, void *subscription) {
  (void)node;
  struct endpoint *gone = subscription;
  leave(&subscriptions, gone);
  free(gone->queue);
  free(gone);
  return 0;
}

int rmw_destroy_publisher(void *node, void *publisher) {
  (void)node;
  leave(&publishers, publisher);
  free(publisher);
  return 0;
}

int rmw_subscription_get_actual_qos(const void *subscription, struct qos *qos) {
  *qos = ((const struct endpoint *)subscription)->qos;
  return 0;
}

int rmw_publisher_get_actual_qos(const void *publisher, struct qos *qos) {
  *qos = ((const struct endpoint *)publisher)->qos;
  return 0;
}

static size_t on_topic(struct endpoint *list, const char *topic) {
  size_t count = 0;
  pthread_mutex_lock(&lock);
  for (struct endpoint *one = list; one != NULL; one = one->next)
    count += strcmp(one->topic, topic) == 0;
  pthread_mutex_unlock(&lock);
  return count;
}

int rmw_subscription_count_matched_publishers(const void *subscription, size_t *matched) {
  *matched = on_topic(publishers, ((const struct endpoint *)subscription)->topic);
  return 0;
}

int rmw_publisher_count_matched_subscriptions(const void *publisher, size_t *matched) {
  *matched = on_topic(subscriptions, ((const struct endpoint *)publisher)->topic);
  return 0;
}

void standin_send(uint16_t port, size_t bytes) {
  static const char data[65507];
  struct sockaddr_in at = {.sin_family = AF_INET, .sin_port = htons(port)};
  at.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  int from = socket(AF_INET, SOCK_DGRAM, 0);
  if (sendto(from, data, bytes, 0, (struct sockaddr *)&at, sizeof at) < 0) abort();
  close(from);
}

/* An odd "poison" number is refused, as a middleware refuses what it can't serialise. */
int rmw_publish(const void *publisher, const void *message, void *allocation) {
  (void)allocation;
  const struct endpoint *from = publisher;
  uint64_t number = *(const uint64_t *)message;
  if (number == UINT64_MAX) return 1;
  if (wire_bytes > 0) standin_send(wire_port, wire_bytes);
  pthread_mutex_lock(&lock);
  for (struct endpoint *to = subscriptions; to != NULL; to = to->next) {
    if (strcmp(to->topic, from->topic) != 0) continue;
    if (to->count == to->room) {
      to->first++, to->count--, to->overwritten++;
    }
    to->queue[(to->first + to->count++) % to->room] = number;
  }
  pthread_cond_broadcast(&arrived);
  pthread_mutex_unlock(&lock);
  return 0;
}

/* By way of rmw_publish, as some middlewares do: one message all the same. */
int rmw_publish_serialized_message(const void *publisher, const void *message, void *allocation) {
  return rmw_publish(publisher, ((const struct serialized *)message)->buffer, allocation);
}

int rmw_publish_loaned_message(const void *publisher, void *message, void *allocation) {
  return rmw_publish(publisher, message, allocation);
}

/* Of each, as queues here have numbers alone. */
void standin_gid(const void *publisher, uint8_t gid[16]) {
  (void)publisher;
  for (int byte = 0; byte < 16; byte++) gid[byte] = (uint8_t)(byte + 1);
}

static bool pop(const void *subscription, uint64_t *number) {
  struct endpoint *from = (struct endpoint *)subscription;
  pthread_mutex_lock(&lock);
  bool any = from->count > 0;
  if (any) {
    *number = from->queue[from->first++ % from->room];
    from->count--;
  }
  pthread_mutex_unlock(&lock);
  return any;
}

int rmw_take_with_info(const void *subscription, void *message, bool *taken, void *info,
                       void *allocation) {
  (void)allocation;
  struct info *says = info;
  *taken = pop(subscription, message);
  if (*taken && says != NULL) {
    says->implementation = ((const struct endpoint *)subscription)->implementation;
    says->source = 0;
    standin_gid(NULL, says->gid);
  }
  return 0;
}

/* By way of the other, as some middlewares do: one take all the same. */
int rmw_take(const void *subscription, void *message, bool *taken, void *allocation) {
  struct info info;
  return rmw_take_with_info(subscription, message, taken, &info, allocation);
}

int rmw_take_serialized_message_with_info(const void *subscription, void *message, bool *taken,
                                          void *info, void *allocation) {
  struct serialized *into = message;
  into->length = sizeof(uint64_t);
  return rmw_take_with_info(subscription, into->buffer, taken, info, allocation);
}

int rmw_take_serialized_message(const void *subscription, void *message, bool *taken,
                                void *allocation) {
  struct info info;
  return rmw_take_serialized_message_with_info(subscription, message, taken, &info, allocation);
}

int rmw_take_loaned_message_with_info(const void *subscription, void **message, bool *taken,
                                      void *info, void *allocation) {
  static __thread uint64_t lent;
  *message = &lent;
  return rmw_take_with_info(subscription, &lent, taken, info, allocation);
}

int rmw_take_loaned_message(const void *subscription, void **message, bool *taken,
                            void *allocation) {
  return rmw_take_loaned_message_with_info(subscription, message, taken, NULL, allocation);
}

int rmw_take_sequence(const void *subscription, size_t count, void *messages, void *infos,
                      size_t *taken, void *allocation) {
  (void)infos, (void)allocation;
  struct sequence *into = messages;
  *taken = 0;
  while (*taken < count && pop(subscription, into->data[*taken])) ++*taken;
  into->size = *taken;
  return 0;
}

int rmw_trigger_guard_condition(const struct guard *guard) {
  pthread_mutex_lock(&lock);
  *(bool *)guard->data = true;
  pthread_cond_broadcast(&arrived);
  pthread_mutex_unlock(&lock);
  return 0;
}

int rmw_destroy_guard_condition(struct guard *guard) {
  guard->data = NULL;
  return 0;
}

/* Under the lock: how many are triggered, which they are no more then; what is not is NULL. */
static size_t guards_taken(const struct set *guards, bool take) {
  size_t ready = 0;
  for (size_t one = 0; guards != NULL && one < guards->count; one++) {
    bool *triggered = guards->subscribers[one];
    ready += *triggered;
    if (take && !*triggered) guards->subscribers[one] = NULL;
    if (take) *triggered = false;
  }
  return ready;
}

int rmw_wait(struct set *wanted, struct set *guards, void *services, void *clients, void *events,
             void *wait_set, const struct span *timeout) {
  (void)services, (void)clients, (void)events, (void)wait_set;
  struct span endless = {1 << 30, 0};
  struct timespec until;
  clock_gettime(CLOCK_REALTIME, &until);
  if (timeout == NULL) timeout = &endless;
  until.tv_sec += (time_t)timeout->seconds;
  until.tv_nsec += (long)timeout->nanoseconds;
  if (until.tv_nsec >= 1000000000) until.tv_sec++, until.tv_nsec -= 1000000000;
  size_t ready = 0;
  pthread_mutex_lock(&lock);
  for (int late = 0; late == 0;) {
    ready = guards_taken(guards, false);
    for (size_t one = 0; one < wanted->count; one++)
      ready += ((struct endpoint *)wanted->subscribers[one])->count > 0;
    if (ready > 0) break;
    late = pthread_cond_timedwait(&arrived, &lock, &until);
  }
  guards_taken(guards, true);
  for (size_t one = 0; one < wanted->count; one++) {
    if (((struct endpoint *)wanted->subscribers[one])->count == 0) wanted->subscribers[one] = NULL;
  }
  pthread_mutex_unlock(&lock);
  return ready > 0 ? 0 : 2;
}

void standin_match(const void *endpoint, bool subscription) { (void)endpoint, (void)subscription; }

uint64_t standin_overwritten(const void *subscription) {
  return ((const struct endpoint *)subscription)->overwritten;
}

uint64_t standin_waiting(const void *subscription) {
  return ((const struct endpoint *)subscription)->count;
}
