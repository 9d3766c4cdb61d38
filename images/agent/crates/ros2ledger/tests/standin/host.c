/* What Python is to rclpy: a program without ROS that loads a module for itself alone; or for all,
 * and again each time that it has left, with "again" as its second argument. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>

int main(int argc, char **argv) {
  int again = argc > 2 && strcmp(argv[2], "again") == 0;
  void *module = dlopen(argv[1], RTLD_NOW | (again ? RTLD_GLOBAL : RTLD_LOCAL));
  if (module == NULL) {
    fprintf(stderr, "%s\n", dlerror());
    return 1;
  }
  int (*serve)(int, char **) = (int (*)(int, char **))dlsym(module, "serve");
  int left = serve(argc, argv);
  dlclose(module);
  /* Whatever was unloaded is not loaded again at its place. */
  for (int hole = 0; again && hole < 256; hole++)
    mmap(NULL, 1 << 14, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  return again && left ? main(argc, argv) : 0;
}
