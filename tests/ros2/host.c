/* What Python is to rclpy: a program without ROS that loads a module, which lies beside it, for
 * itself alone. */
#include <dlfcn.h>
#include <stdio.h>
#include <unistd.h>

int main(int argc, char **argv) {
  char path[4096];
  ssize_t length = readlink("/proc/self/exe", path, sizeof path - 4);
  if (length < 0) return 1;
  snprintf(path + length, 4, ".so");
  void *module = dlopen(path, RTLD_NOW | RTLD_LOCAL);
  if (module == NULL) {
    fprintf(stderr, "%s\n", dlerror());
    return 1;
  }
  int (*serve)(int, char **) = (int (*)(int, char **))dlsym(module, "serve");
  return serve == NULL ? 1 : serve(argc, argv);
}
