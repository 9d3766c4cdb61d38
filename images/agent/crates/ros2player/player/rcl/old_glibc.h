/* Included before all else: the names that a C library of 2020 has too. glibc 2.34 gave all of them a
 * new version. */
#pragma once
#if defined(__x86_64__)
#define OLD_NAME(name) __asm__(".symver " #name ", " #name "@GLIBC_2.2.5")
#elif defined(__aarch64__)
#define OLD_NAME(name) __asm__(".symver " #name ", " #name "@GLIBC_2.17")
#else
#error "which versions of these do old C libraries of this processor have?"
#endif
OLD_NAME(dladdr);
OLD_NAME(dlclose);
OLD_NAME(dlopen);
OLD_NAME(dlsym);
OLD_NAME(dlerror);
OLD_NAME(pthread_create);
