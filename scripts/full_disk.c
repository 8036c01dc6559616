/* A disk on which, from the operation QUADRILLE_TEST_FULL_AT on (with QUADRILLE_TEST_ONCE: that one alone), nothing fits any more. To be
 * preloaded (LD_PRELOAD); heeds what is written to files whose path holds "disk/", and writes the number of such operations to the
 * file QUADRILLE_TEST_COUNT. With QUADRILLE_TEST_CLOCK="N" the time of day jumps by N seconds, forth and back, at every look.
 * For tests/commands/armour.rs and scripts/soak.py. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/uio.h>
#include <time.h>
#include <unistd.h>
static atomic_long operations;
static long limit(void) { const char *text = getenv("QUADRILLE_TEST_FULL_AT"); return text ? atol(text) : 0; }
static int here(const char *path) { return path && strstr(path, "disk/"); }
static int of_disk(int fd) {
    char link[64], path[4096];
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    ssize_t n = readlink(link, path, sizeof path - 1);
    if (n <= 0) return 0;
    path[n] = 0;
    return here(path);
}
/* Whether this operation fails; once is there: it alone. */
static int full(void) {
    long n = ++operations, at = limit();
    return at && (getenv("QUADRILLE_TEST_ONCE") ? n == at : n >= at);
}
#define REAL(name) __typeof__(&name) real = (__typeof__(&name))dlsym(RTLD_NEXT, #name)
#define FAIL do { errno = ENOSPC; return -1; } while (0)
ssize_t write(int fd, const void *data, size_t n) {
    REAL(write);
    if (fd > 2 && of_disk(fd) && full()) {
        if (n > 1 && operations == limit() && !getenv("QUADRILLE_TEST_ONCE")) return real(fd, data, n / 2); /* a last piece fits */
        FAIL;
    }
    return real(fd, data, n);
}
ssize_t pwrite64(int fd, const void *data, size_t n, off64_t at) { REAL(pwrite64); if (of_disk(fd) && full()) FAIL; return real(fd, data, n, at); }
ssize_t writev(int fd, const struct iovec *data, int n) { REAL(writev); if (fd > 2 && of_disk(fd) && full()) FAIL; return real(fd, data, n); }
int fsync(int fd) { REAL(fsync); if (of_disk(fd) && full()) FAIL; return real(fd); }
int fdatasync(int fd) { REAL(fdatasync); if (of_disk(fd) && full()) FAIL; return real(fd); }
int mkdir(const char *path, mode_t mode) { REAL(mkdir); if (here(path) && full()) FAIL; return real(path, mode); }
int rename(const char *from, const char *to) { REAL(rename); if (here(to) && full()) FAIL; return real(from, to); }
int open64(const char *path, int flags, ...) {
    REAL(open64);
    va_list rest; va_start(rest, flags); mode_t mode = va_arg(rest, int); va_end(rest);
    if ((flags & O_CREAT) && here(path) && full()) FAIL;
    return real(path, flags, mode);
}
int open(const char *path, int flags, ...) {
    REAL(open);
    va_list rest; va_start(rest, flags); mode_t mode = va_arg(rest, int); va_end(rest);
    if ((flags & O_CREAT) && here(path) && full()) FAIL;
    return real(path, flags, mode);
}
int clock_gettime(clockid_t clock, struct timespec *now) {
    REAL(clock_gettime);
    static atomic_long looks;
    int said = real(clock, now);
    const char *jump = getenv("QUADRILLE_TEST_CLOCK");
    if (said == 0 && clock == CLOCK_REALTIME && jump) now->tv_sec += (++looks % 2 ? 1 : -1) * atol(jump);
    return said;
}
__attribute__((destructor)) static void tell(void) {
    const char *name = getenv("QUADRILLE_TEST_COUNT");
    FILE *file = name ? fopen(name, "w") : 0;
    if (file) { fprintf(file, "%ld\n", (long)operations); fclose(file); }
}
