/* A node of the stand-in: what it is asked for, and what it counts. */
#pragma once
#include <pthread.h>
#include <stdatomic.h>

#include "rmw.h"

#define MOST 1024 /* endpoints of each kind, and threads */
#define WITHIN 16 /* messages that a subscription keeps that were handed over within the process */

struct publisher {
  char topic[256];
  struct rmw_endpoint *rmw;
  bool relays;
  _Atomic uint64_t published;
};

/* What a subscription's callback does with a message. */
enum work { WORK_NOTHING, WORK_TEXT, WORK_STAMP, WORK_STEER };

struct subscription {
  char topic[256];
  struct rmw_endpoint *rmw;
  enum work work;
  struct publisher *into;
  struct message message;        /* the one that its callback has */
  char rcl[2], cpp[2], callback[2]; /* their addresses are what tracepoints name */
  char intra[2], intra_callback[2]; /* and of what is handed over within the process */
  int turn;                         /* which of the two: one ends while the next one is there */
  bool gone;
  bool busy;                     /* a thread has it: its callbacks exclude each other */
  _Atomic uint64_t taken, called;
  struct message handed[WITHIN]; /* the oldest is `first` */
  size_t first, waiting;
};

struct asked {
  char name[256], space[256];
  struct {
    char topic[256], package[128], folder[8], type[128];
    struct rmw_qos qos;
    uint64_t renew_at, apart_us, slow_us; /* of a subscription alone; 0: not */
    bool goes;
  } subscription[MOST], publisher[MOST];
  int subscriptions, publishers;
  struct {
    char from[256], into[256];
    enum work work;
  } relay[MOST];
  int relays, threads, fails_with;
  bool sim_time, overlaps, within, wakeful;
  int timer; /* the clock of the timer by which it publishes, or 0: a thread does */
  uint64_t delay_us, spins_late_us, first_us, die_after, drop_every, renew_every, apart_us, answers, burst, every_us,
      doze_every, answers_from, answer_bytes, loses, returns_us, in_all, knows;
  char counts[512], awaits[256], goes_on[256];
  int life; /* the state in which its life cycle begins, or 0: it has none */
  uint64_t leave_after, ends_after, awaits_at;
};

/* lifecycle_msgs/msg/State */
enum state { INACTIVE = 2, ACTIVE = 3, ACTIVATING = 13, DEACTIVATING = 14 };

extern struct asked asked;
extern struct rmw_context context;
extern struct rmw_node *node;

/* node_options.c: reads the arguments; ends the program with a sentence if they make no sense. */
void read_arguments(int argc, char **argv);

/* node_work.c: the callback of a message, and the simulated time that it reads. */
void sleep_us(uint64_t us);
void run_us(uint64_t us);
void work(struct subscription *of);
void set_time(const struct message *clock);
void say(struct publisher *into); /* a String with how many it has reported */

/* node_within.c: what is handed over within the process. The oldest gives way where there is no room. */
void put_within(struct subscription *into, const uint8_t *bytes, size_t length);
bool waits_within(struct subscription *of);
bool take_within(struct subscription *from, struct message *message); /* whose bytes are the caller's */

/* node_life.c: its life cycle, if it has one. */
void life_begins(void);
void life_turns(void); /* from inactive to active, and back */
void life_ends(void);

/* node.c */
const struct type_support *message_type(const char *package, const char *folder, const char *type);
const struct type_support *service_type(const char *package, const char *type);
void publish(struct publisher *into, const uint8_t *bytes, size_t length);
