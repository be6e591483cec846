/* Loss and delay of UDP datagrams for a process that is started with LD_PRELOAD=lossy.so, where the kernel has no netem.
 *
 * LOSSY_LOSS and LOSSY_HELD are shares of the datagrams: lost, and sent with the first datagram that follows at least
 * LOSSY_DELAY ms later. Fast DDS sends with sendmsg, through asio.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>

enum { HELD = 256, SIZE = 65536 };

static struct { int fd; size_t length; socklen_t name; double due; struct sockaddr_storage to; char *data; } held[HELD];
static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static unsigned int seed = 1;

static double option(const char *name) { const char *text = getenv(name); return text ? atof(text) : 0.0; }

static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec + 1e-9 * t.tv_nsec;
}

ssize_t sendmsg(int fd, const struct msghdr *message, int flags) {
    static ssize_t (*send)(int, const struct msghdr *, int);
    if (!send) send = (ssize_t (*)(int, const struct msghdr *, int))dlsym(RTLD_NEXT, "sendmsg");
    int type = 0;
    socklen_t size = sizeof type;
    if (getsockopt(fd, SOL_SOCKET, SO_TYPE, &type, &size) || type != SOCK_DGRAM || !message->msg_name ||
        ((struct sockaddr *)message->msg_name)->sa_family == AF_UNIX)
        return send(fd, message, flags);
    size_t length = 0;
    for (size_t k = 0; k < message->msg_iovlen; k++) length += message->msg_iov[k].iov_len;
    pthread_mutex_lock(&lock);
    double time = now(), draw = rand_r(&seed) / (RAND_MAX + 1.0), loss = option("LOSSY_LOSS");
    int slot = -1;
    for (int k = 0; k < HELD; k++) {
        if (held[k].data && held[k].due <= time) {
            sendto(held[k].fd, held[k].data, held[k].length, MSG_DONTWAIT, (struct sockaddr *)&held[k].to, held[k].name);
            free(held[k].data);
            held[k].data = NULL;
        }
        if (!held[k].data) slot = k;
    }
    int hold = draw >= loss && draw < loss + option("LOSSY_HELD") && slot >= 0 && length <= SIZE;
    if (hold && (held[slot].data = malloc(length ? length : 1))) {
        char *end = held[slot].data;
        for (size_t k = 0; k < message->msg_iovlen; k++)
            end = (char *)mempcpy(end, message->msg_iov[k].iov_base, message->msg_iov[k].iov_len);
        held[slot].fd = fd;
        held[slot].length = length;
        held[slot].name = message->msg_namelen;
        held[slot].due = time + 1e-3 * option("LOSSY_DELAY");
        memcpy(&held[slot].to, message->msg_name, message->msg_namelen);
    }
    pthread_mutex_unlock(&lock);
    return hold || draw < loss ? (ssize_t)length : send(fd, message, flags);
}
