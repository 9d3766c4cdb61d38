/* A node that is led by lines on its standard input and answers each with one line. Built twice:
 * like rclcpp, with tracepoints and linked as programs are; and with -DWITHOUT_TRACEPOINTS like
 * rclpy, loaded for itself alone. It counts for itself what the ledger must have. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <pthread.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "rcl.h"
#include "rmw.h"
#ifdef WITHOUT_TRACEPOINTS
#define TRACE(call) ((void)0)
#define TRACED() 0ull
#else
#include "tracetools.h"
#define TRACE(call) call
#define TRACED() (unsigned long long)standin_traced()
#endif

#define MOST 8192

struct subscription {
  char topic[512], way[16]; /* how it takes */
  void *rmw;
  char rcl, cpp, callback, intra, intra_callback; /* their addresses are what counts */
  _Atomic uint64_t taken, called, intra_waiting, intra_called;
  _Atomic uint64_t last; /* the number that was taken last */
  struct publisher *relay; /* what its callback publishes on; none if NULL */
};
struct publisher {
  char topic[512];
  void *rmw;
  uint64_t sent;
};

static struct subscription *subscriptions[MOST];
static struct publisher *publishers[MOST];
static int subscription_count, publisher_count, errno_after;
static struct subscription *ghost; /* the one that was destroyed last */
static struct node node = {"standin", NULL, "node", "/"};
static const struct node *creator = &node;
static pthread_mutex_t waiting = PTHREAD_MUTEX_INITIALIZER;
static _Atomic int flooding, stick, nest, destroy_inside;

/* What a wait is given for an endpoint. */
static void *data_of(void *rmw) { return ((struct node *)rmw)->data; }

static struct subscription *subscription_on(const char *topic) {
  for (int i = subscription_count - 1; i >= 0; i--)
    if (strcmp(subscriptions[i]->topic, topic) == 0) return subscriptions[i];
  abort();
}

static struct publisher *publisher_on(const char *topic) {
  for (int i = publisher_count - 1; i >= 0; i--)
    if (strcmp(publishers[i]->topic, topic) == 0) return publishers[i];
  abort();
}

static struct subscription *subscribe(const char *topic, struct qos qos, const char *way) {
  struct subscription *made = calloc(1, sizeof *made);
  strcpy(made->topic, topic);
  strcpy(made->way, way);
  made->last = UINT64_MAX;
  errno = 0;
  made->rmw = rmw_create_subscription(creator, NULL, topic, &qos, NULL);
  errno_after = errno;
  TRACE(ros_trace_rcl_subscription_init(&made->rcl, NULL, made->rmw, topic, qos.depth));
  if (strcmp(way, "serialized") == 0) return made; /* as rclcpp's generic ones: no callback */
  if (strcmp(way, "intra") == 0) {
    TRACE(ros_trace_rclcpp_subscription_callback_added(&made->intra, &made->intra_callback));
    TRACE(ros_trace_rclcpp_subscription_init(&made->rcl, &made->intra));
  }
  if (strcmp(way, "early") == 0) /* as no rclcpp does by now */
    TRACE(ros_trace_rclcpp_subscription_callback_added(&made->cpp, &made->callback));
  TRACE(ros_trace_rclcpp_subscription_init(&made->rcl, &made->cpp));
  if (strcmp(way, "early") != 0)
    TRACE(ros_trace_rclcpp_subscription_callback_added(&made->cpp, &made->callback));
  return made;
}

static struct publisher *advertise(const char *topic, struct qos qos) {
  struct publisher *made = calloc(1, sizeof *made);
  strcpy(made->topic, topic);
  made->rmw = rmw_create_publisher(creator, NULL, topic, &qos, NULL);
  return made;
}

static void publish(struct publisher *publisher, uint64_t number, const char *way) {
  struct serialized bytes = {(uint8_t *)&number, sizeof number, sizeof number, {0}};
  int refused;
  if (strcmp(way, "serialized") == 0)
    refused = rmw_publish_serialized_message(publisher->rmw, &bytes, NULL);
  else if (strcmp(way, "loaned") == 0)
    refused = rmw_publish_loaned_message(publisher->rmw, &number, NULL);
  else
    refused = rmw_publish(publisher->rmw, &number, NULL);
  publisher->sent += !refused;
}

/* One take in the subscription's way: how many messages came. */
static size_t take(struct subscription *from) {
  uint64_t numbers[4] = {UINT64_MAX};
  void *places[4] = {numbers, numbers + 1, numbers + 2, numbers + 3}, *lent;
  struct serialized bytes = {(uint8_t *)numbers, 0, sizeof numbers, {0}};
  struct sequence sequence = {places, 0, 4};
  struct info info;
  bool taken = false;
  size_t many = 0;
  if (strcmp(from->way, "bare") == 0)
    rmw_take(from->rmw, numbers, &taken, NULL);
  else if (strcmp(from->way, "serialized") == 0)
    rmw_take_serialized_message_with_info(from->rmw, &bytes, &taken, &info, NULL);
  else if (strcmp(from->way, "raw") == 0)
    rmw_take_serialized_message(from->rmw, &bytes, &taken, NULL);
  else if (strcmp(from->way, "loaned") == 0)
    rmw_take_loaned_message_with_info(from->rmw, &lent, &taken, &info, NULL);
  else if (strcmp(from->way, "sequence") == 0)
    rmw_take_sequence(from->rmw, 4, &sequence, NULL, &many, NULL);
  else
    rmw_take_with_info(from->rmw, numbers, &taken, &info, NULL);
  if (taken) from->last = numbers[0];
  return taken ? 1 : many;
}

static bool spin_once(uint64_t milliseconds);
static void destroy(struct subscription *of);

static void call(struct subscription *of, const char *callback, _Atomic uint64_t *count) {
  (void)callback;
  TRACE(ros_trace_callback_start(callback, callback == &of->intra_callback));
  ++*count;
  if (of->relay != NULL) publish(of->relay, *count, "plain");
  if (atomic_exchange(&destroy_inside, 0)) destroy(of);
  if (atomic_exchange(&stick, 0)) {
    printf("stuck\n");
    for (;;) pause();
  }
  if (atomic_exchange(&nest, 0)) spin_once(0);
  TRACE(ros_trace_callback_end(callback));
}

/* A timer's callback, which publishes on the topic where there is one. */
static void tick(struct publisher *to) {
  static const char timer;
  (void)timer;
  TRACE(ros_trace_callback_start(&timer, false));
  if (to != NULL) publish(to, 1, "plain");
  if (atomic_exchange(&stick, 0)) {
    printf("stuck\n");
    for (;;) pause();
  }
  if (atomic_exchange(&nest, 0)) spin_once(0);
  TRACE(ros_trace_callback_end(&timer));
}

/* Calls a timer of that clock so often, by both functions in turn. */
static void fire(const char *of, uint64_t times) {
  struct rcl_clock clock = {CLOCK_ROS_TIME, strcmp(of, "simulated") == 0};
  struct rcl_timer timer = {&clock, strcmp(of, "cancelled") == 0, 0};
  struct rcl_timer_info info;
  if (strcmp(of, "steady") == 0) clock.type = CLOCK_STEADY_TIME;
  if (strcmp(of, "system") == 0) clock.type = CLOCK_SYSTEM_TIME;
  for (uint64_t i = 0; i < times; i++)
    i % 2 == 0 ? rcl_timer_call(&timer) : rcl_timer_call_with_info(&timer, &info);
}

/* A copy of what came within the process: rclcpp takes it and calls nothing. */
static void *take_away(void *of) {
  ((struct subscription *)of)->taken += take(of);
  return NULL;
}

/* What an executor does with one ready subscription: false if there was none in time. */
static bool spin_once(uint64_t milliseconds) {
  void *ready[MOST];
  struct span timeout = {0, milliseconds * 1000000};
  pthread_mutex_lock(&waiting);
  for (int i = 0; i < subscription_count; i++) ready[i] = data_of(subscriptions[i]->rmw);
  struct set set = {(size_t)subscription_count, ready};
  int result = rmw_wait(&set, NULL, NULL, NULL, NULL, NULL, &timeout);
  pthread_mutex_unlock(&waiting);
  if (result != 0) return false;
  for (int i = 0; i < subscription_count; i++) {
    if (ready[i] == NULL) continue;
    size_t many = take(subscriptions[i]);
    subscriptions[i]->taken += many;
    for (; many > 0; many--) call(subscriptions[i], &subscriptions[i]->callback, &subscriptions[i]->called);
  }
  return true;
}

static void *spin(void *unused) {
  (void)unused;
  for (int i = 0; i < subscription_count; i++) {
    struct subscription *of = subscriptions[i];
    while (of->intra_waiting > 0) {
      of->intra_waiting--;
      call(of, &of->intra_callback, &of->intra_called);
    }
  }
  while (spin_once(1) || flooding) continue;
  return NULL;
}

static void spin_threads(int threads) {
  pthread_t other[64];
  for (int i = 1; i < threads; i++) pthread_create(&other[i], NULL, spin, NULL);
  spin(NULL);
  for (int i = 1; i < threads; i++) pthread_join(other[i], NULL);
}

/* A thread of the middleware itself, which takes by rmw_take from a subscription of its own, as that
 * of rmw_cyclonedds does with each participant that comes. */
static void *discover(void *unused) {
  (void)unused;
  void *rmw = dlopen("librmw_implementation.so", RTLD_NOLOAD | RTLD_LAZY);
  __typeof__(&rmw_create_subscription) create =
      (__typeof__(&rmw_create_subscription))dlsym(rmw, "rmw_create_subscription");
  struct qos qos = {1, 10, 1, 2, {0}};
  void *own = create(creator, NULL, "/of_the_middleware", &qos, NULL);
  uint64_t number;
  bool taken;
  rmw_take(own, &number, &taken, NULL);
  return NULL;
}

/* A thread that waits without end until there is a message, and does not take it. */
static void *sleep_on(void *rmw) {
  void *ready[1] = {data_of(rmw)};
  struct set set = {1, ready};
  int result = rmw_wait(&set, NULL, NULL, NULL, NULL, NULL, NULL);
  printf("woke %d %d\n", result, ready[0] == data_of(rmw));
  return NULL;
}

static bool triggered;
static struct guard guard = {"standin", &triggered};

/* A thread that waits for the guard, and as many times as are asked for again: what woke it is in
 * its hand until then. */
static _Atomic uint64_t guard_waits, guard_woken;
static void *await_guard(void *unused) {
  (void)unused;
  for (;;) {
    while (guard_waits == 0) usleep(100);
    guard_waits--;
    void *data[1] = {guard.data};
    struct set none = {0, NULL}, guards = {1, data};
    guard_woken += rmw_wait(&none, &guards, NULL, NULL, NULL, NULL, NULL) == 0;
  }
  return NULL;
}

static struct publisher *flood_publisher;
static void *flood(void *messages) {
  for (uint64_t i = 0; i < (uint64_t)messages; i++) publish(flood_publisher, i, "plain");
  flooding = 0;
  return NULL;
}

/* A reentrant callback, called by as many threads at once as there are. */
static struct subscription *stormed;
static void *storm(void *calls) {
  for (uint64_t i = 0; i < (uint64_t)calls; i++)
    call(stormed, &stormed->callback, &stormed->called);
  return NULL;
}

static void answer_fork(void) {
  int nobody = fork();
  if (nobody == 0) exit(9);
  waitpid(nobody, NULL, 0);
  int child = fork();
  if (child == 0) {
    /* What was its parent's, then an endpoint of its own, which has its parent's address. */
    struct qos qos = {1, 10, 1, 2, {0}};
    struct subscription *parents = subscriptions[0];
    publish(publishers[0], 1, "plain");
    take(parents);
    call(parents, &parents->callback, &parents->called);
    rmw_destroy_subscription(NULL, parents->rmw);
    struct subscription *own = subscriptions[0] = subscribe("/of_the_child", qos, "plain");
    struct publisher *publisher = advertise("/of_the_child", qos);
    subscription_count = 1;
    for (int i = 0; i < 3; i++) publish(publisher, 1, "plain");
    spin(NULL);
    printf("child %d took %llu called %llu\n", getpid(), (unsigned long long)own->taken,
           (unsigned long long)own->called);
    exit(4);
  }
  waitpid(child, NULL, 0);
}

static double now(void) {
  struct timespec time;
  clock_gettime(CLOCK_MONOTONIC, &time);
  return (double)time.tv_sec * 1e9 + (double)time.tv_nsec;
}

/* Nanoseconds of one message published, waited for, taken and called. */
static void answer_cost(const char *topic, uint64_t messages) {
  struct subscription *of = subscription_on(topic);
  struct publisher *publisher = publisher_on(topic);
  struct span timeout = {0, 0};
  double begin = now();
  for (uint64_t i = 0; i < messages; i++) {
    void *ready[1] = {data_of(of->rmw)};
    struct set set = {1, ready};
    publish(publisher, i, "plain");
    rmw_wait(&set, NULL, NULL, NULL, NULL, NULL, &timeout);
    of->taken += take(of);
    call(of, &of->callback, &of->called);
  }
  printf("%.2f\n", (now() - begin) / (double)messages);
}

static void answer_report(const char *topic) {
  struct subscription *of = subscription_on(topic);
  printf("taken %llu called %llu intra %llu overwritten %llu waiting %llu traced %llu\n",
         (unsigned long long)of->taken, (unsigned long long)of->called,
         (unsigned long long)of->intra_called, (unsigned long long)standin_overwritten(of->rmw),
         (unsigned long long)standin_waiting(of->rmw), TRACED());
}

static void destroy(struct subscription *of) {
  rmw_destroy_subscription(NULL, of->rmw);
  int kept = 0;
  for (int i = 0; i < subscription_count; i++)
    if (subscriptions[i] != of) subscriptions[kept++] = subscriptions[i];
  subscription_count = kept;
  ghost = of;
}

static void churn(const char *topic, uint64_t times) {
  struct qos qos = {1, 10, 1, 2, {0}};
  for (uint64_t i = 0; i < times; i++) {
    struct subscription *made = subscribe(topic, qos, "intra");
    destroy(made);
    free(made);
  }
}

/* The node that creates from now on; none is named "-". */
static void be(const char *name_space, const char *name) {
  node.name_space = strdup(name_space);
  node.name = strdup(name);
  creator = strcmp(name, "-") == 0 ? NULL : &node;
}

static void hang(void) {
  printf("hangs\n");
  fflush(stdout);
  for (;;) pause();
}

static void obey(char **argv, const char *verb, const char *topic, uint64_t n, const char *way) {
  /* Publishers are reliable, and so is a subscription that asks for it. */
  struct qos qos = {1, n, verb[0] == 'p' || !strcmp(way, "reliable") ? 1 : 2, 2, {0}};
  struct qos chosen_by_middleware = {0, 0, 0, 0, {0}};
  /* A deadline of 1.25 s, no lifespan, manual by topic, a lease of 2 s; and without end, as rmw says it. */
  struct qos timely = {1, 5, 1, 2, {1, 250000000, 0, 0, 3, 2, 0, 0}};
  struct qos endless = {1, 5, 1, 2, {9223372036, 854775807, 0, 0, 1, 9223372036, 854775806, 0}};
  pthread_t thread;
  if (!strcmp(verb, "sub")) subscriptions[subscription_count++] = subscribe(topic, qos, way);
  else if (!strcmp(verb, "timely"))
    subscriptions[subscription_count++] = subscribe(topic, timely, way);
  else if (!strcmp(verb, "endless"))
    subscriptions[subscription_count++] = subscribe(topic, endless, way);
  else if (!strcmp(verb, "default"))
    subscriptions[subscription_count++] = subscribe(topic, chosen_by_middleware, way);
  else if (!strcmp(verb, "subs"))
    while (n-- > 0) subscriptions[subscription_count++] = subscribe(topic, qos, way);
  else if (!strcmp(verb, "pub")) publishers[publisher_count++] = advertise(topic, qos);
  else if (!strcmp(verb, "publish"))
    while (n-- > 0) publish(publisher_on(topic), n, way);
  else if (!strcmp(verb, "wire")) standin_wire((uint16_t)atoi(topic), n);
  else if (!strcmp(verb, "send")) standin_send((uint16_t)atoi(topic), n);
  else if (!strcmp(verb, "poison")) publish(publisher_on(topic), UINT64_MAX, way);
  else if (!strcmp(verb, "flood")) {
    flooding = 1;
    flood_publisher = publisher_on(topic);
    pthread_create(&thread, NULL, flood, (void *)n);
    spin_threads(atoi(way));
    pthread_join(thread, NULL);
    spin(NULL);
  } else if (!strcmp(verb, "busy")) { /* others come and go while it floods */
    pthread_t other[64];
    flooding = 1;
    flood_publisher = publisher_on(topic);
    pthread_create(&thread, NULL, flood, (void *)n);
    for (int i = 0; i < atoi(way); i++) pthread_create(&other[i], NULL, spin, NULL);
    do churn("/short", 10);
    while (flooding);
    for (int i = 0; i < atoi(way); i++) pthread_join(other[i], NULL);
    pthread_join(thread, NULL);
    spin(NULL);
  } else if (!strcmp(verb, "storm")) {
    pthread_t other[64];
    stormed = subscription_on(topic);
    for (int i = 0; i < atoi(way); i++) pthread_create(&other[i], NULL, storm, (void *)n);
    for (int i = 0; i < atoi(way); i++) pthread_join(other[i], NULL);
  } else if (!strcmp(verb, "spin")) spin_threads((int)n);
  else if (!strcmp(verb, "last"))
    while (subscription_on(topic)->last != 0) spin_once(100);
  else if (!strcmp(verb, "total"))
    while (subscription_on(topic)->taken < n) spin_once(100);
  else if (!strcmp(verb, "match") && !strcmp(way, "sub"))
    standin_match(subscription_on(topic)->rmw, true);
  else if (!strcmp(verb, "match")) standin_match(publisher_on(topic)->rmw, false);
  else if (!strcmp(verb, "hand")) subscription_on(topic)->intra_waiting += n;
  else if (!strcmp(verb, "stick")) stick = 1;
  else if (!strcmp(verb, "guard")) { /* as many waits for it */
    static bool begun;
    guard_waits += n;
    if (!begun) pthread_create(&thread, NULL, await_guard, NULL);
    begun = true;
  } else if (!strcmp(verb, "trigger"))
    while (n-- > 0) rmw_trigger_guard_condition(&guard);
  else if (!strcmp(verb, "woken"))
    while (guard_woken < n) usleep(100);
  else if (!strcmp(verb, "unguard")) rmw_destroy_guard_condition(&guard);
  else if (!strcmp(verb, "nest")) nest = 1;
  else if (!strcmp(verb, "ghost")) /* a timer whose callback is where a subscription's was */
    call(ghost, &ghost->callback, &ghost->called);
  else if (!strcmp(verb, "inside")) destroy_inside = 1;
  else if (!strcmp(verb, "tick"))
    while (n-- > 0) tick(strcmp(topic, "/") == 0 ? NULL : publisher_on(topic));
  else if (!strcmp(verb, "discover")) {
    pthread_create(&thread, NULL, discover, NULL);
    pthread_join(thread, NULL);
  } else if (!strcmp(verb, "fire")) fire(way, n);
  else if (!strcmp(verb, "discard"))
    while (n-- > 0) take_away(subscription_on(topic));
  else if (!strcmp(verb, "brief")) { /* a thread that takes one and ends */
    pthread_create(&thread, NULL, take_away, subscription_on(topic));
    pthread_join(thread, NULL);
  }
  else if (!strcmp(verb, "relay")) subscription_on(topic)->relay = publisher_on(way);
  else if (!strcmp(verb, "be")) be(topic, way);
  else if (!strcmp(verb, "sleep")) {
    pthread_create(&thread, NULL, sleep_on, subscription_on(topic)->rmw);
    pthread_detach(thread);
  }
  else if (!strcmp(verb, "pubs"))
    while (n-- > 0) publishers[publisher_count++] = advertise(topic, qos);
  else if (!strcmp(verb, "empty"))
    while (n-- > 0) take(subscription_on(topic));
  else if (!strcmp(verb, "destroy")) destroy(subscription_on(topic));
  else if (!strcmp(verb, "unpublish")) rmw_destroy_publisher(NULL, publisher_on(topic)->rmw);
  else if (!strcmp(verb, "churn")) churn(topic, n);
  else if (!strcmp(verb, "sent")) {
    printf("%llu\n", (unsigned long long)publisher_on(topic)->sent);
    return;
  } else if (!strcmp(verb, "gid")) {
    uint8_t gid[16];
    standin_gid(publisher_on(topic)->rmw, gid);
    for (int byte = 0; byte < 16; byte++) printf("%02x", gid[byte]);
    puts("");
    return;
  } else if (!strcmp(verb, "report")) {
    answer_report(topic);
    return;
  } else if (!strcmp(verb, "cost")) {
    answer_cost(topic, n);
    return;
  } else if (!strcmp(verb, "fork")) {
    answer_fork();
    return;
  } else if (!strcmp(verb, "errno")) {
    printf("%d\n", errno_after);
    return;
  } else if (!strcmp(verb, "thread")) {
    printf("%ld\n", (long)syscall(SYS_gettid));
    return;
  } else if (!strcmp(verb, "exec")) execv(argv[0], argv);
  else if (!strcmp(verb, "hang_at_exit")) atexit(hang);
  else if (!strcmp(verb, "exit")) exit((int)n);
  else if (!strcmp(verb, "_exit")) _exit((int)n);
  else abort();
  printf("done\n");
}

int serve(int argc, char **argv) {
  char line[1024], verb[16], topic[512], way[16];
  (void)argc;
  setvbuf(stdin, NULL, _IONBF, 0); /* a program that is executed gets the next line */
  setvbuf(stdout, NULL, _IOLBF, 0);
  printf("ready\n");
  while (fgets(line, sizeof line, stdin) != NULL) {
    unsigned long long n = 0;
    strcpy(topic, "/");
    strcpy(way, "plain");
    sscanf(line, "%15s %511s %llu %15s", verb, topic, &n, way);
    if (strcmp(verb, "leave") == 0) return 1;
    if (strcmp(verb, "become") == 0) execlp("sleep", "sleep", "600", NULL);
    obey(argv, verb, topic, n, way);
  }
  return 0;
}

#ifndef WITHOUT_TRACEPOINTS
int main(int argc, char **argv) { return serve(argc, argv); }
#endif
