/* What Python is to rclpy: a program without ROS that loads a module for itself alone. */
#include <dlfcn.h>
#include <stdio.h>

int main(int argc, char **argv) {
  void *module = dlopen(argv[1], RTLD_NOW | RTLD_LOCAL);
  if (module == NULL) {
    fprintf(stderr, "%s\n", dlerror());
    return 1;
  }
  int (*serve)(int, char **) = (int (*)(int, char **))dlsym(module, "serve");
  return serve(argc, argv);
}
