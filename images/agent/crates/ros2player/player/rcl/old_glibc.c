/* The start of a program: newer start files ask for a newer one, and old ones know no other. */
#if defined(__x86_64__)
__asm__(".symver old_start_main, __libc_start_main@GLIBC_2.2.5");
#elif defined(__aarch64__)
__asm__(".symver old_start_main, __libc_start_main@GLIBC_2.17");
#endif

typedef int program(int, char **, char **);
int old_start_main(program *, int, char **, void (*)(void), void (*)(void), void (*)(void), void *);
int __wrap___libc_start_main(program *, int, char **, void (*)(void), void (*)(void),
                             void (*)(void), void *);

int __wrap___libc_start_main(program *entry, int argc, char **argv, void (*before)(void),
                             void (*after)(void), void (*loader)(void), void *stack) {
  return old_start_main(entry, argc, argv, before, after, loader, stack);
}
