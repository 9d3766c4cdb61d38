/* A node that waits once for each line, as it says, and reports what became of it. */
#include <stdio.h>
#include <stdlib.h>

#include "script.h"

static struct set sets[SETS];

/* Fills the sets with so many things; -1 is no set at all. */
static void fill(const int *many, struct set **into) {
  for (int set = 0; set < SETS; set++) {
    into[set] = many[set] < 0 ? NULL : &sets[set];
    if (into[set] == NULL) continue;
    free(sets[set].subscribers);
    sets[set].count = (size_t)many[set];
    sets[set].subscribers = many[set] == 0 ? NULL : malloc(sizeof(void *) * (size_t)many[set]);
    for (int thing = 0; thing < many[set]; thing++)
      sets[set].subscribers[thing] = THING((uint64_t)set, (uint64_t)thing);
  }
}

static void report(int result, struct set **of, uint64_t began) {
  const struct seen *seen = script_seen();
  printf("result %d calls %llu spoilt %llu longest %llu last %lld passed %llu samples %llu ready",
         result, (unsigned long long)seen->calls, (unsigned long long)seen->spoilt,
         (unsigned long long)seen->longest, (long long)seen->last,
         (unsigned long long)(script_clock() - began), (unsigned long long)seen->samples);
  for (uint64_t set = 0; set < SETS; set++)
    for (uint64_t thing = 0; of[set] != NULL && thing < of[set]->count; thing++)
      if (of[set]->subscribers[thing] != NULL)
        printf(" %llu:%llu%s", (unsigned long long)set, (unsigned long long)thing,
               of[set]->subscribers[thing] == THING(set, thing) ? "" : "?");
  printf("\n");
}

int main(void) {
  struct qos qos = {1, 1, 1, 2, {0}};
  char line[256];
  setvbuf(stdin, NULL, _IONBF, 0);
  setvbuf(stdout, NULL, _IOLBF, 0);
  rmw_create_subscription(NULL, NULL, "/scan", &qos, NULL);
  printf("ready\n");
  while (fgets(line, sizeof line, stdin) != NULL) {
    struct script script = {0};
    struct set *of[SETS];
    int many[SETS];
    long long timeout;
    if (sscanf(line, "%d %d %d %d %d %lld %lu %d %d %lu %lu %lu", &many[0], &many[1], &many[2],
               &many[3], &many[4], &timeout, &script.act_at, &script.result, &script.set,
               &script.index, &script.pause_at, &script.late) != 12)
      abort();
    struct span span = {(uint64_t)timeout / 1000000000ull, (uint64_t)timeout % 1000000000ull};
    uint64_t began = script_clock();
    fill(many, of);
    script_run(&script);
    int result =
        rmw_wait(of[0], of[1], of[2], of[3], of[4], NULL, timeout < 0 ? NULL : &span);
    report(result, of, began);
  }
  return 0;
}
