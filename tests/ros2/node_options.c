#define _GNU_SOURCE
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "node.h"
#include "rcl_timer.h"

static const char usage[] =
    "--name [/NAMESPACE]/NAME   the node\n"
    "--sub TOPIC:PACKAGE/msg/TYPE:DEPTH:reliable|best_effort[:transient_local]\n"
    "                       a subscription; DEPTH is a number, or 'all'\n"
    "--pub as --sub\n"
    "--presence DEADLINE:LEASE:automatic|manual\n"
    "                       of those that follow, in ms; 0 is without end\n"
    "--relay IN=OUT         for each message on IN a String on OUT:\n"
    "                       '<hash of it> <count>[ <time>]'\n"
    "--relay-stamp IN=OUT   for each message on IN a PoseStamped on OUT, with its header's stamp\n"
    "--steer IN=OUT         for each message on IN a Twist on OUT: as many tenths of a m/s as\n"
    "                       messages came\n"
    "--use-sim-time         takes /clock in a thread of its own; --relay adds the time\n"
    "--delay-us N           how long each callback takes\n"
    "--spins-late-us N      how long it sleeps before it takes anything\n"
    "--first-us N           how long the first of a topic takes besides\n"
    "--drop-every N         each Nth message of a topic gets no answer\n"
    "--answers N            each other one gets so many, in place of one\n"
    "--answers-from N       a message of fewer bytes gets none\n"
    "--answer-bytes N       --relay's answers are so long\n"
    "--renew-every N        after each Nth message a subscription is destroyed and created again\n"
    "--apart-us N           how long it has none in between\n"
    "--renew I:N:US         once, after the Nth message of the Ith --sub, with so long in between\n"
    "--overlaps             the other one is created before the one is destroyed\n"
    "--gone I               after its next message from SIGUSR2 on the Ith --sub is destroyed for good\n"
    "--slow I:US            how long callbacks of the Ith --sub take besides\n"
    "--doze-every N         after each Nth of the first hundred messages of a topic no more are taken\n"
    "                       until another one comes, whatever waits\n"
    "--die-after N          aborts in the callback of the Nth message of a topic\n"
    "--ends-after N         leaves in order, with status 0, in the callback of the Nth message of a topic\n"
    "--awaits N:FILE        in the callback of the Nth message of a topic it waits until FILE is there,\n"
    "                       and ends with status 4 after a minute in vain\n"
    "--fails-with STATUS    ends with it as soon as it is in the graph\n"
    "--threads N            threads that take and call\n"
    "--within               what it publishes on a topic that it subscribes to is handed over within it\n"
    "--returns-us N         how long a thread computes after each callback before it waits again\n"
    "--wakeful              has a thread besides that never sleeps\n"
    "--meets-late-ms N      what it publishes so soon after it created a publisher reaches nobody, as\n"
    "                       its middleware knows no subscription until then\n"
    "--lists-late-ms N      how long a subscription is in the graph before the node, and so its ledger,\n"
    "                       has it\n"
    "--returns-late-us N    how long a call that publishes goes on after its message went out\n"
    "--loses MANY           of what it publishes so many are lost on the way, from SIGUSR2 on\n"
    "--origins gid|none     messages have their publisher as other middlewares give it, or not at all\n"
    "--burst N              Strings at once on each publisher that no relay has\n"
    "--every-us N           and then one after the other, by a thread outside of callbacks\n"
    "--in-all N             no more of these than so many on each\n"
    "--knows N              none of them before its publishers know so many subscriptions, together\n"
    "--goes-on FILE         after the burst none before FILE is there\n"
    "--timer wall|ros       in callbacks of a timer of the machine's clock, or of ROS' simulated time\n"
    "--life-cycle STATE     has one, which begins inactive or active and goes on by SIGUSR1\n"
    "--leave-after N        is made inactive in the callback of the Nth message of a topic\n"
    "--count-to FILE        where its own counts go at its end: lines of\n"
    "                       'sub TOPIC taken N called N' and 'pub TOPIC published N'\n";

struct asked asked = {.threads = 1, .answers = 1};

static _Noreturn void refuse(const char *why, const char *what) {
  fprintf(stderr, "standin_node: %s: %s\n%s", why, what, usage);
  exit(2);
}

static void name(const char *whole) {
  const char *slash = strrchr(whole, '/');
  if (slash == NULL || strlen(whole) > 250) refuse("no name", whole);
  snprintf(asked.name, sizeof asked.name, "%s", slash + 1);
  snprintf(asked.space, sizeof asked.space, "%.*s", (int)(slash - whole), whole);
  if (slash == whole) strcpy(asked.space, "/");
}

static struct rmw_qos presence; /* the rest of it is not read */

static void promise(const char *text) {
  unsigned deadline, lease;
  char kind[16];
  if (sscanf(text, "%u:%u:%15s", &deadline, &lease, kind) != 3) refuse("no deadline and lease", text);
  presence.deadline = (struct rmw_time){deadline / 1000, deadline % 1000 * 1000000ull};
  presence.lease = (struct rmw_time){lease / 1000, lease % 1000 * 1000000ull};
  presence.liveliness = !strcmp(kind, "manual") ? LIVELINESS_MANUAL_BY_TOPIC : 1;
}

static struct rmw_qos qos_of(const char *depth, const char *reliability, const char *durability) {
  struct rmw_qos qos = presence;
  bool all = strcmp(depth, "all") == 0;
  qos.history = all ? HISTORY_KEEP_ALL : HISTORY_KEEP_LAST;
  qos.depth = all ? 0 : strtoul(depth, NULL, 10);
  bool best_effort = strcmp(reliability, "best_effort") == 0;
  qos.reliability = best_effort ? RELIABILITY_BEST_EFFORT : RELIABILITY_RELIABLE;
  bool late = strcmp(durability, "transient_local") == 0;
  qos.durability = late ? DURABILITY_TRANSIENT_LOCAL : DURABILITY_VOLATILE;
  return qos;
}

static void endpoint(bool subscribes, const char *text) {
  int *count = subscribes ? &asked.subscriptions : &asked.publishers;
  char depth[32], reliability[32], durability[32] = "";
  if (*count == MOST) refuse("too many", text);
  __typeof__(&asked.publisher[0]) into =
      subscribes ? (void *)&asked.subscription[*count] : &asked.publisher[*count];
  int found = sscanf(text, "%255[^:]:%127[^/]/%7[^/]/%127[^:]:%31[^:]:%31[^:]:%31s", into->topic,
                     into->package, into->folder, into->type, depth, reliability, durability);
  if (found < 6) refuse("no topic with its type and quality of service", text);
  into->qos = qos_of(depth, reliability, durability);
  ++*count;
}

static void relay(enum work work, const char *text) {
  if (asked.relays == MOST) refuse("too many", text);
  if (sscanf(text, "%255[^=]=%255s", asked.relay[asked.relays].from,
             asked.relay[asked.relays].into) != 2)
    refuse("no two topics", text);
  asked.relay[asked.relays++].work = work;
}

/* The subscription that a text begins with the number of, from 1 on, and the numbers behind. */
static __typeof__(&asked.subscription[0]) one_of(const char *text, int numbers, unsigned long long *of) {
  unsigned long long which = 0;
  int found = sscanf(text, "%llu:%llu:%llu", &which, &of[0], &of[1]);
  if (found != 1 + numbers || which < 1 || which > (unsigned long long)asked.subscriptions)
    refuse("no subscription before it, and numbers", text);
  return &asked.subscription[which - 1];
}

static void renew_once(const char *text) {
  unsigned long long of[2];
  __typeof__(&asked.subscription[0]) one = one_of(text, 2, of);
  one->renew_at = of[0];
  one->apart_us = of[1];
}

static void gone(const char *text) {
  unsigned long long of[2];
  __typeof__(&asked.subscription[0]) one = one_of(text, 0, of);
  one->goes = true;
}

static void slow(const char *text) {
  unsigned long long of[2];
  __typeof__(&asked.subscription[0]) one = one_of(text, 1, of);
  one->slow_us = of[0];
}

static void await_at(const char *text) {
  if (sscanf(text, "%" SCNu64 ":%255s", &asked.awaits_at, asked.awaits) != 2)
    refuse("no number and file", text);
}

static void value(const char *option, const char *text) {
  if (!strcmp(option, "--name")) name(text);
  else if (!strcmp(option, "--sub")) endpoint(true, text);
  else if (!strcmp(option, "--pub")) endpoint(false, text);
  else if (!strcmp(option, "--presence")) promise(text);
  else if (!strcmp(option, "--relay")) relay(WORK_TEXT, text);
  else if (!strcmp(option, "--relay-stamp")) relay(WORK_STAMP, text);
  else if (!strcmp(option, "--steer")) relay(WORK_STEER, text);
  else if (!strcmp(option, "--delay-us")) asked.delay_us = strtoull(text, NULL, 10);
  else if (!strcmp(option, "--spins-late-us")) asked.spins_late_us = strtoull(text, NULL, 10);
  else if (!strcmp(option, "--first-us")) asked.first_us = strtoull(text, NULL, 10);
  else if (!strcmp(option, "--drop-every")) asked.drop_every = strtoull(text, NULL, 10);
  else if (!strcmp(option, "--answers")) asked.answers = strtoull(text, NULL, 10);
  else if (!strcmp(option, "--answers-from")) asked.answers_from = strtoull(text, NULL, 10);
  else if (!strcmp(option, "--answer-bytes")) asked.answer_bytes = strtoull(text, NULL, 10);
  else if (!strcmp(option, "--renew-every")) asked.renew_every = strtoull(text, NULL, 10);
  else if (!strcmp(option, "--apart-us")) asked.apart_us = strtoull(text, NULL, 10);
  else if (!strcmp(option, "--renew")) renew_once(text);
  else if (!strcmp(option, "--gone")) gone(text);
  else if (!strcmp(option, "--slow")) slow(text);
  else if (!strcmp(option, "--doze-every")) asked.doze_every = strtoull(text, NULL, 10);
  else if (!strcmp(option, "--die-after")) asked.die_after = strtoull(text, NULL, 10);
  else if (!strcmp(option, "--ends-after")) asked.ends_after = strtoull(text, NULL, 10);
  else if (!strcmp(option, "--awaits")) await_at(text);
  else if (!strcmp(option, "--fails-with")) asked.fails_with = atoi(text);
  else if (!strcmp(option, "--burst")) asked.burst = strtoull(text, NULL, 10);
  else if (!strcmp(option, "--every-us")) asked.every_us = strtoull(text, NULL, 10);
  else if (!strcmp(option, "--in-all")) asked.in_all = strtoull(text, NULL, 10);
  else if (!strcmp(option, "--knows")) asked.knows = strtoull(text, NULL, 10);
  else if (!strcmp(option, "--goes-on")) snprintf(asked.goes_on, sizeof asked.goes_on, "%s", text);
  else if (!strcmp(option, "--timer"))
    asked.timer = !strcmp(text, "wall") ? CLOCK_STEADY_TIME : CLOCK_ROS_TIME;
  else if (!strcmp(option, "--returns-us")) asked.returns_us = strtoull(text, NULL, 10);
  else if (!strcmp(option, "--threads")) asked.threads = atoi(text);
  else if (!strcmp(option, "--meets-late-ms")) setenv(MEETS_LATE, text, 1);
  else if (!strcmp(option, "--lists-late-ms")) setenv(LISTS_LATE, text, 1);
  else if (!strcmp(option, "--returns-late-us")) setenv(RETURNS_LATE, text, 1);
  else if (!strcmp(option, "--loses")) asked.loses = strtoull(text, NULL, 10);
  else if (!strcmp(option, "--origins")) setenv(ORIGINS, text, 1);
  else if (!strcmp(option, "--leave-after")) asked.leave_after = strtoull(text, NULL, 10);
  else if (!strcmp(option, "--life-cycle"))
    asked.life = !strcmp(text, "active") ? ACTIVE : INACTIVE;
  else if (!strcmp(option, "--count-to")) snprintf(asked.counts, sizeof asked.counts, "%s", text);
  else refuse("no option", option);
}

void read_arguments(int argc, char **argv) {
  strcpy(asked.name, "standin");
  strcpy(asked.space, "/");
  for (int at = 1; at < argc; at++) {
    if (!strcmp(argv[at], "--ros-args")) break; /* the client library's, which this one has not */
    if (!strcmp(argv[at], "--use-sim-time")) {
      asked.sim_time = true;
    } else if (!strcmp(argv[at], "--overlaps")) {
      asked.overlaps = true;
    } else if (!strcmp(argv[at], "--within")) {
      asked.within = true;
    } else if (!strcmp(argv[at], "--wakeful")) {
      asked.wakeful = true;
    } else if (at + 1 == argc) {
      refuse("no value", argv[at]);
    } else {
      value(argv[at], argv[at + 1]);
      at++;
    }
  }
  if (asked.threads < 1 || asked.threads > MOST) refuse("no number of threads", "--threads");
  if (asked.loses > 0 && standin_lose == NULL) refuse("no way to lose anything", "--loses");
  if (asked.doze_every > 0 && standin_has_news == NULL) refuse("no way to know what comes", "--doze-every");
  /* Another thread may wait for the subscription that is destroyed. */
  if (asked.renew_every > 0 && (asked.threads > 1 || asked.sim_time))
    refuse("one thread renews alone", "--renew-every");
}
