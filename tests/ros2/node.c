/* A node that relays, as its arguments say. It takes and reports as rclcpp's executors do: threads
 * wait in turn; a subscription's callbacks exclude each other. -DWITHOUT_TRACEPOINTS makes it one
 * like rclpy's. SIGINT and SIGTERM end it; SIGUSR1 has its life cycle
 * go on; at SIGUSR2 it loses what it is to lose. */
#define _GNU_SOURCE
#include "node.h"
#include "rcl_timer.h"

#include <dlfcn.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#ifdef WITHOUT_TRACEPOINTS
#define TRACE(call) ((void)0)
#else
#include "tracetools.h"
#define TRACE(call) call
#endif

struct rmw_context context;
struct rmw_node *node;

static struct subscription subscriptions[MOST], clock_subscription;
static struct publisher publishers[MOST];
static struct rmw_guard *changed, *clock_ends, *handed_over;
static struct rmw_wait_set *set, *clock_set;
static pthread_mutex_t waiting = PTHREAD_MUTEX_INITIALIZER; /* one thread waits */
static pthread_mutex_t choosing = PTHREAD_MUTEX_INITIALIZER; /* of `busy` */
static _Atomic bool ending;
static _Atomic bool losing; /* a subscription, with its next message */

static _Noreturn void fail(const char *what) {
  fprintf(stderr, "standin_node: %s: %s\n", what, rcutils_get_error_string().str);
  exit(1);
}

static const struct type_support *found_in(const char *package, const char *symbol) {
  char library[300];
  snprintf(library, sizeof library, "lib%s__rosidl_typesupport_c.so", package);
  void *loaded = dlopen(library, RTLD_NOW);
  const void *(*get)(void) =
      loaded == NULL ? NULL : (const void *(*)(void))dlsym(loaded, symbol);
  if (get == NULL) {
    fprintf(stderr, "standin_node: %s\n", dlerror());
    exit(1);
  }
  return get();
}

const struct type_support *message_type(const char *package, const char *folder,
                                        const char *type) {
  char symbol[400];
  snprintf(symbol, sizeof symbol,
           "rosidl_typesupport_c__get_message_type_support_handle__%s__%s__%s", package, folder,
           type);
  return found_in(package, symbol);
}

const struct type_support *service_type(const char *package, const char *type) {
  char symbol[400];
  snprintf(symbol, sizeof symbol,
           "rosidl_typesupport_c__get_service_type_support_handle__%s__srv__%s", package, type);
  return found_in(package, symbol);
}

/* Whether somebody of this process subscribes, and has it now: then nobody else is given it. */
static bool hand_over(const char *topic, const uint8_t *bytes, size_t length) {
  bool any = false;
  for (int one = 0; one < asked.subscriptions && asked.within; one++) {
    if (strcmp(subscriptions[one].topic, topic) != 0) continue;
    put_within(&subscriptions[one], bytes, length);
    any = true;
  }
  if (any) rmw_trigger_guard_condition(handed_over);
  return any;
}

void publish(struct publisher *into, const uint8_t *bytes, size_t length) {
  if (hand_over(into->topic, bytes, length)) return;
  struct message message = {(uint8_t *)bytes, length};
  if (rmw_publish(into->rmw, &message, NULL) == RMW_OK) into->published++;
}

static void subscribe(struct subscription *made, const char *topic, const struct type_support *type,
                      const struct rmw_qos *qos) {
  snprintf(made->topic, sizeof made->topic, "%s", topic);
  made->rmw = rmw_create_subscription(node, type, topic, qos, NULL);
  if (made->rmw == NULL) fail(topic);
  int turn = made->turn;
  (void)turn;
  TRACE(ros_trace_rcl_subscription_init(&made->rcl[turn], node, made->rmw, topic, qos->depth));
  if (asked.within) {
    TRACE(ros_trace_rclcpp_subscription_callback_added(&made->intra[turn], &made->intra_callback[turn]));
    TRACE(ros_trace_rclcpp_subscription_init(&made->rcl[turn], &made->intra[turn]));
  }
  TRACE(ros_trace_rclcpp_subscription_init(&made->rcl[turn], &made->cpp[turn]));
  TRACE(ros_trace_rclcpp_subscription_callback_added(&made->cpp[turn], &made->callback[turn]));
}

static void create_endpoints(void) {
  for (int one = 0; one < asked.publishers; one++) {
    __typeof__(&asked.publisher[0]) of = &asked.publisher[one];
    snprintf(publishers[one].topic, sizeof publishers[one].topic, "%s", of->topic);
    const struct type_support *type = message_type(of->package, of->folder, of->type);
    publishers[one].rmw = rmw_create_publisher(node, type, of->topic, &of->qos, NULL);
    if (publishers[one].rmw == NULL) fail(of->topic);
  }
  for (int one = 0; one < asked.subscriptions; one++) {
    __typeof__(&asked.subscription[0]) of = &asked.subscription[one];
    subscribe(&subscriptions[one], of->topic, message_type(of->package, of->folder, of->type), &of->qos);
  }
  struct rmw_qos newest = {.history = HISTORY_KEEP_LAST, .depth = 1,
                           .reliability = RELIABILITY_BEST_EFFORT,
                           .durability = DURABILITY_VOLATILE};
  if (asked.sim_time)
    subscribe(&clock_subscription, "/clock", message_type("rosgraph_msgs", "msg", "Clock"), &newest);
}

static void connect_relays(void) {
  for (int one = 0; one < asked.relays; one++) {
    struct subscription *from = NULL;
    struct publisher *into = NULL;
    for (int at = 0; at < asked.subscriptions; at++)
      if (!strcmp(subscriptions[at].topic, asked.relay[one].from)) from = &subscriptions[at];
    for (int at = 0; at < asked.publishers; at++)
      if (!strcmp(publishers[at].topic, asked.relay[one].into)) into = &publishers[at];
    if (from == NULL || into == NULL) {
      fprintf(stderr, "standin_node: --relay needs a --sub %s and a --pub %s\n",
              asked.relay[one].from, asked.relay[one].into);
      exit(2);
    }
    from->into = into;
    into->relays = true;
    from->work = asked.relay[one].work;
  }
}

/* Destroys it and creates it again, as nodes do whose parameters change; or creates another one first, as
 * an assignment to a pointer in C++ does. */
static void renew(struct subscription *of, uint64_t apart_us) {
  __typeof__(&asked.subscription[0]) as = &asked.subscription[of - subscriptions];
  struct rmw_endpoint *before = of->rmw;
  if (!asked.overlaps) rmw_destroy_subscription(node, before);
  if (!asked.overlaps) sleep_us(apart_us);
  of->turn = 1 - of->turn;
  subscribe(of, as->topic, message_type(as->package, as->folder, as->type), &as->qos);
  if (asked.overlaps) sleep_us(apart_us);
  if (asked.overlaps) rmw_destroy_subscription(node, before);
}

static void renew_if_asked(struct subscription *of) {
  if (of == &clock_subscription) return;
  __typeof__(&asked.subscription[0]) as = &asked.subscription[of - subscriptions];
  if (as->slow_us > 0) sleep_us(as->slow_us);
  if (asked.renew_every > 0 && of->taken % asked.renew_every == 0) renew(of, asked.apart_us);
  if (of->taken == as->renew_at) renew(of, as->apart_us);
  if (!as->goes || !losing) return;
  rmw_destroy_subscription(node, of->rmw);
  of->gone = true;
}

/* As executors do whose threads have missed that messages wait. */
static void doze(const struct subscription *of) {
  bool dozes = asked.doze_every > 0 && of->taken <= 100 && of->taken % asked.doze_every == 0;
  while (dozes && !ending && !standin_has_news(of->rmw)) sleep_us(200);
}

/* Calls back with what was handed over within the process, if there is something. */
static bool execute_within(struct subscription *of) {
  struct message handed, taken = of->message;
  if (!take_within(of, &handed)) return false;
  const void *callback = &of->intra_callback[of->turn];
  (void)callback;
  TRACE(ros_trace_callback_start(callback, true));
  of->message = handed;
  work(of);
  of->message = taken;
  TRACE(ros_trace_callback_end(callback));
  free(handed.data);
  return true;
}

/* Takes a message, if there is one, and calls back. */
static void execute(struct subscription *of) {
  if (execute_within(of)) return;
  bool taken = false;
  struct rmw_info info;
  if (rmw_take_with_info(of->rmw, &of->message, &taken, &info, NULL) != RMW_OK) fail(of->topic);
  if (!taken) return;
  of->taken++;
  const void *callback = &of->callback[of->turn];
  (void)callback;
  TRACE(ros_trace_callback_start(callback, false));
  if (of == &clock_subscription) {
    set_time(&of->message);
    of->called++;
  } else {
    work(of);
  }
  renew_if_asked(of);
  TRACE(ros_trace_callback_end(callback));
  doze(of);
}

/* Waits for one of the subscriptions that nobody has, and reserves it; NULL if there was none. */
static struct subscription *next_ready(void) {
  void *wanted[MOST], *guard[2] = {changed->data, handed_over->data};
  struct subscription *of[MOST], *chosen = NULL;
  struct rmw_things things = {0, wanted}, guards = {asked.within ? 2 : 1, guard};
  struct rmw_time limit = {1, 0};
  pthread_mutex_lock(&choosing);
  for (int one = 0; one < asked.subscriptions; one++) {
    if (subscriptions[one].busy || subscriptions[one].gone) continue;
    if (waits_within(&subscriptions[one])) rmw_trigger_guard_condition(handed_over);
    of[things.count] = &subscriptions[one];
    wanted[things.count++] = subscriptions[one].rmw->data;
  }
  pthread_mutex_unlock(&choosing);
  if (rmw_wait(&things, &guards, NULL, NULL, NULL, set, &limit) != RMW_OK) return NULL;
  static size_t turn; /* so that none starves another */
  pthread_mutex_lock(&choosing);
  for (size_t one = 0; one < things.count && chosen == NULL; one++) {
    size_t at = (one + turn) % things.count;
    if (wanted[at] != NULL || waits_within(of[at])) chosen = of[at];
  }
  turn++;
  if (chosen != NULL) chosen->busy = true;
  pthread_mutex_unlock(&choosing);
  return chosen;
}

static void *spin(void *unused) {
  (void)unused;
  while (!ending) {
    pthread_mutex_lock(&waiting);
    struct subscription *ready = ending ? NULL : next_ready();
    pthread_mutex_unlock(&waiting);
    if (ready == NULL) continue;
    execute(ready);
    if (asked.returns_us > 0) run_us(asked.returns_us);
    pthread_mutex_lock(&choosing);
    ready->busy = false;
    pthread_mutex_unlock(&choosing);
    if (asked.threads > 1) rmw_trigger_guard_condition(changed);
  }
  return NULL;
}

/* As that of a driver which asks its device all the time. */
static void *wake(void *unused) {
  (void)unused;
  while (!ending) continue;
  return NULL;
}

/* As rclcpp's thread for /clock. */
static void *follow_clock(void *unused) {
  (void)unused;
  while (!ending) {
    void *wanted[1] = {clock_subscription.rmw->data}, *guard[1] = {clock_ends->data};
    struct rmw_things things = {1, wanted}, guards = {1, guard};
    struct rmw_time limit = {1, 0};
    rmw_wait(&things, &guards, NULL, NULL, NULL, clock_set, &limit);
    if (wanted[0] != NULL) execute(&clock_subscription);
  }
  return NULL;
}

static void say_on_all(uint64_t times) {
  for (int one = 0; one < asked.publishers; one++)
    for (uint64_t time = 0; time < times && !publishers[one].relays; time++) say(&publishers[one]);
}

/* As an executor calls a timer: once it is marked as called, its callback. */
static void call_timer(void) {
  struct rcl_clock clock = {asked.timer, asked.timer == CLOCK_ROS_TIME};
  struct rcl_timer timer = {&clock};
  if (rcl_timer_call(&timer) != 0) fail("no timer");
  TRACE(ros_trace_callback_start(&asked.timer, false));
  say_on_all(1);
  TRACE(ros_trace_callback_end(&asked.timer));
}

/* Whether its publishers know as many subscriptions as it waits for. */
static bool is_known(void) {
  size_t all = 0, of_one;
  for (int one = 0; one < asked.publishers; one++) {
    if (rmw_publisher_count_matched_subscriptions(publishers[one].rmw, &of_one) != RMW_OK) fail("no count");
    all += of_one;
  }
  return all >= asked.knows;
}

static void *talk(void *unused) {
  (void)unused;
  while (!ending && !is_known()) sleep_us(1000);
  say_on_all(asked.burst);
  while (!ending && asked.goes_on[0] != 0 && access(asked.goes_on, F_OK) != 0) sleep_us(1000);
  for (uint64_t of_each = asked.burst; !ending && asked.every_us > 0; of_each++) {
    if (asked.in_all > 0 && of_each >= asked.in_all) break;
    sleep_us(asked.every_us);
    asked.timer == 0 ? say_on_all(1) : call_timer();
  }
  return NULL;
}

static void write_counts(void) {
  FILE *file = asked.counts[0] == 0 ? NULL : fopen(asked.counts, "w");
  if (file == NULL) return;
  for (int one = 0; one <= asked.subscriptions; one++) {
    const struct subscription *of =
        one < asked.subscriptions ? &subscriptions[one] : &clock_subscription;
    if (of->rmw != NULL)
      fprintf(file, "sub %s taken %llu called %llu\n", of->topic, (unsigned long long)of->taken,
              (unsigned long long)of->called);
  }
  for (int one = 0; one < asked.publishers; one++)
    fprintf(file, "pub %s published %llu\n", publishers[one].topic,
            (unsigned long long)publishers[one].published);
  if (standin_deaths != NULL && standin_deaths() > 0)
    fprintf(file, "publishers taken for dead %lu\n", standin_deaths());
  fclose(file);
}

static void lose(void) {
  if (asked.loses > 0) standin_lose(asked.loses);
  losing = true;
}

static void wait_for_signal(const sigset_t *wanted) {
  int signal;
  while (sigwait(wanted, &signal) == 0 && (signal == SIGUSR1 || signal == SIGUSR2))
    signal == SIGUSR1 ? life_turns() : lose();
  ending = true;
  for (int one = 0; one < asked.threads; one++) rmw_trigger_guard_condition(changed);
  rmw_trigger_guard_condition(clock_ends);
}

int serve(int argc, char **argv);

int serve(int argc, char **argv) {
  pthread_t threads[MOST], clock_thread, talking, wakeful;
  sigset_t wanted;
  read_arguments(argc, argv);
  sigemptyset(&wanted);
  sigaddset(&wanted, SIGINT);
  sigaddset(&wanted, SIGTERM);
  sigaddset(&wanted, SIGUSR1);
  sigaddset(&wanted, SIGUSR2);
  pthread_sigmask(SIG_BLOCK, &wanted, NULL);
  if (rmw_init(NULL, &context) != RMW_OK) fail("no context");
  node = rmw_create_node(&context, asked.name, asked.space);
  if (node == NULL) fail("no node");
  changed = rmw_create_guard_condition(&context);
  clock_ends = rmw_create_guard_condition(&context);
  handed_over = rmw_create_guard_condition(&context);
  set = rmw_create_wait_set(&context, MOST);
  clock_set = rmw_create_wait_set(&context, 2);
  create_endpoints();
  if (asked.fails_with != 0) exit(asked.fails_with);
  connect_relays();
  life_begins();
  sleep_us(asked.spins_late_us);
  for (int one = 0; one < asked.threads; one++) pthread_create(&threads[one], NULL, spin, NULL);
  if (asked.sim_time) pthread_create(&clock_thread, NULL, follow_clock, NULL);
  if (asked.wakeful) pthread_create(&wakeful, NULL, wake, NULL);
  pthread_create(&talking, NULL, talk, NULL);
  wait_for_signal(&wanted);
  pthread_join(talking, NULL);
  for (int one = 0; one < asked.threads; one++) pthread_join(threads[one], NULL);
  if (asked.sim_time) pthread_join(clock_thread, NULL);
  if (asked.wakeful) pthread_join(wakeful, NULL);
  write_counts();
  life_ends();
  for (int one = 0; one < asked.subscriptions; one++)
    if (!subscriptions[one].gone) rmw_destroy_subscription(node, subscriptions[one].rmw);
  for (int one = 0; one < asked.publishers; one++) rmw_destroy_publisher(node, publishers[one].rmw);
  rmw_destroy_node(node);
  rmw_context_fini(&context);
  return 0;
}

#ifndef WITHOUT_TRACEPOINTS
int main(int argc, char **argv) { return serve(argc, argv); }
#endif
