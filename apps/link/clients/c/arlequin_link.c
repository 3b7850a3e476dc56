/* The solver's end of a link; see arlequin_link.h. */
#define _POSIX_C_SOURCE 200809L
#include "arlequin_link.h"

#include <arpa/inet.h>
#include <errno.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <time.h>
#include <unistd.h>

#ifndef MSG_NOSIGNAL
#define MSG_NOSIGNAL 0
#endif

enum { VERSION = 1, HEADER = 16, NAME = 1024 };
enum { HELLO = 1, WEIGH, SHARES, ADVANCE, IMPULSE, TELL, SAVE, RESTORE, END };
enum { DESCRIPTION = 65, ASK, INERTIA, STATE, RECORD, DONE, WORKING, FAILED };
enum { V = 1, Q = 2, A = 4, INVARIANT = 8, MEMORY = 16 };
static const uint64_t LIMIT = (uint64_t)1 << 30;

struct buffer {
    unsigned char *bytes;
    size_t length, room;
};

struct arlequin_link {
    int socket;
    struct buffer out, in;
};

static char reason[NAME];
static struct arlequin_link *current;

/* Bytes of a text, of a long one as many as end with a whole character of UTF-8. */
static size_t length_of(const char *text, size_t most) {
    size_t n = strlen(text);
    if (n <= most) return n;
    for (n = most; n && (text[n] & 0xc0) == 0x80;) n--;
    return n;
}

int arlequin_fail(const char *text) {
    snprintf(reason, sizeof reason, "%.*s", (int)length_of(text, sizeof reason - 1), text);
    return 1;
}
const char *arlequin_reason(void) { return reason; }
struct arlequin_link *arlequin_current(void) { return current; }

static int fail_system(const char *what) {
    snprintf(reason, sizeof reason, "%s: %s", what, strerror(errno));
    return 1;
}

static int reserve(struct buffer *b, size_t room) {
    unsigned char *bytes;
    if (room <= b->room) return 0;
    if (room < 2 * b->room) room = 2 * b->room;
    bytes = realloc(b->bytes, room);
    if (!bytes) return arlequin_fail("no memory left");
    b->bytes = bytes;
    b->room = room;
    return 0;
}

/* Little-endian on any machine. */
static void store(unsigned char *to, uint64_t x, int bytes) {
    for (int k = 0; k < bytes; k++) to[k] = (unsigned char)(x >> 8 * k);
}
static uint64_t load(const unsigned char *from, int bytes) {
    uint64_t x = 0;
    for (int k = 0; k < bytes; k++) x |= (uint64_t)from[k] << 8 * k;
    return x;
}
static double load_number(const unsigned char *from) {
    uint64_t bits = load(from, 8);
    double x;
    memcpy(&x, &bits, 8);
    return x;
}

static int put(struct buffer *b, uint64_t x, int bytes) {
    if (reserve(b, b->length + (size_t)bytes)) return 1;
    store(b->bytes + b->length, x, bytes);
    b->length += (size_t)bytes;
    return 0;
}
static int put_numbers(struct buffer *b, const double *x, size_t count) {
    if (reserve(b, b->length + 8 * count)) return 1;
    for (size_t k = 0; k < count; k++) {
        uint64_t bits;
        memcpy(&bits, x + k, 8);
        store(b->bytes + b->length + 8 * k, bits, 8);
    }
    b->length += 8 * count;
    return 0;
}
static int put_text(struct buffer *b, const char *text) {
    size_t n = length_of(text, NAME);
    if (put(b, n, 4) || reserve(b, b->length + n)) return 1;
    memcpy(b->bytes + b->length, text, n);
    b->length += n;
    return 0;
}

static int begin(struct arlequin_link *l, int kind) {
    l->out.length = 0;
    if (reserve(&l->out, HEADER)) return 1;
    memcpy(l->out.bytes, "ARLQ", 4);
    store(l->out.bytes + 4, VERSION, 2);
    store(l->out.bytes + 6, (uint64_t)kind, 2);
    l->out.length = HEADER;
    return 0;
}

static int send_out(struct arlequin_link *l) {
    store(l->out.bytes + 8, l->out.length - HEADER, 8);
    for (size_t at = 0; at < l->out.length;) {
        ssize_t n = send(l->socket, l->out.bytes + at, l->out.length - at, MSG_NOSIGNAL);
        if (n < 0 && errno == EINTR) continue;
        if (n <= 0) return fail_system("sending to the run");
        at += (size_t)n;
    }
    return 0;
}

static int fill(struct arlequin_link *l, size_t count) {
    size_t at = 0;
    if (reserve(&l->in, count)) return 1;
    while (at < count) {
        ssize_t n = recv(l->socket, l->in.bytes + at, count - at, 0);
        if (n < 0 && errno == EINTR) continue;
        if (n < 0) return fail_system("reading from the run");
        if (n == 0) return arlequin_fail("the run is gone");
        at += (size_t)n;
    }
    l->in.length = count;
    return 0;
}

/* Kind of the next message, or -1. */
static int receive(struct arlequin_link *l) {
    uint64_t length;
    int kind;
    if (fill(l, HEADER)) return -1;
    if (memcmp(l->in.bytes, "ARLQ", 4) || load(l->in.bytes + 4, 2) != VERSION) {
        arlequin_fail("this side speaks version 1 of the protocol");
        if (!begin(l, FAILED) && !put_text(&l->out, reason)) send_out(l);
        return -1;
    }
    kind = (int)load(l->in.bytes + 6, 2);
    length = load(l->in.bytes + 8, 8);
    if (length > LIMIT) {
        arlequin_fail("the run announced a message above the limit");
        return -1;
    }
    return fill(l, (size_t)length) ? -1 : kind;
}

int arlequin_working(struct arlequin_link *l) { return begin(l, WORKING) || send_out(l); }

int arlequin_weights(struct arlequin_link *l, enum arlequin_share share, enum arlequin_places what, size_t count,
                     const double *points, double *out) {
    static const size_t corners[] = {1, 2, 4, 8};
    const double section = 1;
    if (!l) {
        for (size_t k = 0; k < count; k++) out[k] = 1;
        return 0;
    }
    if (begin(l, ASK) || put(&l->out, share, 1) || put(&l->out, what, 3) || put(&l->out, count, 4)) return 1;
    if (put_numbers(&l->out, &section, 1) || put_numbers(&l->out, points, 3 * corners[what] * count)) return 1;
    if (send_out(l)) return 1;
    if (receive(l) != SHARES || l->in.length != 8 * count) return arlequin_fail("the run did not tell its weights");
    for (size_t k = 0; k < count; k++) out[k] = load_number(l->in.bytes + 8 * k);
    return 0;
}

static int describe(struct arlequin_link *l, struct arlequin_solver *s, double *work) {
    static const size_t corners[] = {2, 2, 4, 8};
    struct buffer *b = &l->out;
    size_t dofs = s->nodes * (size_t)(s->components + s->rotations);
    double critical;
    int offers = V | Q | (s->accelerations ? A : 0) | (s->invariant ? INVARIANT : 0) | (s->memory ? MEMORY : 0);
    if (s->weigh(s->self, NULL, work, &critical) || begin(l, DESCRIPTION)) return 1;
    if (put(b, LIMIT, 8) || put(b, (uint64_t)offers, 4) || put(b, (uint64_t)s->components, 1)) return 1;
    if (put(b, (uint64_t)s->rotations, 1) || put(b, s->shape, 2) || put(b, s->nodes, 8) || put(b, s->cells, 8)) return 1;
    if (put_numbers(b, &s->section, 1) || put_numbers(b, &critical, 1)) return 1;
    if (put_text(b, s->name) || put_text(b, s->kind)) return 1;
    if (put_numbers(b, s->positions, 3 * s->nodes) || put_numbers(b, work, dofs)) return 1;
    if (s->shape == ARLEQUIN_PARTICLES && put_numbers(b, s->volumes, s->nodes)) return 1;
    for (size_t k = 0; k < s->cells * corners[s->shape]; k++)
        if (put(b, s->cell_nodes[k], 4)) return 1;
    return send_out(l);
}

static int tell(struct arlequin_link *l, struct arlequin_solver *s, uint32_t wanted, double *work, size_t dofs) {
    int (*const arrays[])(void *, double *) = {s->velocities, s->displacements, s->accelerations};
    double energy = 0;
    if (wanted & INVARIANT && s->invariant(s->self, &energy)) return 1;
    if (begin(l, STATE) || put(&l->out, wanted, 8) || put_numbers(&l->out, &energy, 1)) return 1;
    for (int k = 0; k < 3; k++)
        if (wanted & 1u << k && (arrays[k](s->self, work) || put_numbers(&l->out, work, dofs))) return 1;
    return 0;
}

/* Does what the message says and writes the answer; failures of the solver leave their reason. */
static int answer(struct arlequin_link *l, struct arlequin_solver *s, int kind, double *work) {
    size_t dofs = s->nodes * (size_t)(s->components + s->rotations);
    static const size_t least[] = {0, 12, 8, 0, 24, 0, 8, 0, 16, 0};
    const unsigned char *in = l->in.bytes;
    double critical;
    if (kind < WEIGH || kind > END || l->in.length < least[kind]) return arlequin_fail("this message is not due");
    switch (kind) {
    case ADVANCE:
        if (s->advance(s->self, load_number(in), load_number(in + 8))) return 1;
        return tell(l, s, (uint32_t)load(l->in.bytes + 16, 4), work, dofs);
    case TELL:
        return tell(l, s, (uint32_t)load(in, 4), work, dofs);
    case WEIGH:
        if (s->weigh(s->self, l, work, &critical)) return 1;
        return begin(l, INERTIA) || put_numbers(&l->out, &critical, 1) || put_numbers(&l->out, work, dofs);
    case IMPULSE:
        if (l->in.length != 8 * dofs) return arlequin_fail("the impulse has another length than the unknowns");
        for (size_t k = 0; k < dofs; k++) work[k] = load_number(in + 8 * k);
        if (s->kick(s->self, work)) return 1;
        break;
    case SAVE:
        if (!s->memory || s->save(s->self, work)) return 1;
        return begin(l, RECORD) || put(&l->out, s->memory, 8) || put(&l->out, 0, 8) ||
               put_numbers(&l->out, work, s->memory);
    case RESTORE:
        if (l->in.length != 16 + 8 * s->memory) return arlequin_fail("this was saved by another solver");
        for (size_t k = 0; k < s->memory; k++) work[k] = load_number(in + 16 + 8 * k);
        if (s->restore(s->self, work)) return 1;
        break;
    }
    return begin(l, DONE);
}

static int connect_to(const char *address) {
    struct sockaddr_un un = {.sun_family = AF_UNIX};
    struct sockaddr_in in = {.sin_family = AF_INET};
    const struct sockaddr *at = (const struct sockaddr *)&un;
    socklen_t length = sizeof un;
    const struct timespec pause = {0, 20000000};
    int is_unix = !strncmp(address, "unix:", 5), one = 1;
    if (is_unix) {
        if (strlen(address + 5) >= sizeof un.sun_path) return arlequin_fail("the path of the socket is too long"), -1;
        strcpy(un.sun_path, address + 5);
    } else {
        const char *host = strchr(address, ':'), *port = strrchr(address, ':');
        char ip[64] = "";
        if (host && port > host) snprintf(ip, sizeof ip, "%.*s", (int)(port - host - 1), host + 1);
        if (!strcmp(ip, "localhost")) strcpy(ip, "127.0.0.1");
        if (inet_pton(AF_INET, ip, &in.sin_addr) != 1) return arlequin_fail("the address is not unix:PATH or tcp:IP:PORT"), -1;
        in.sin_port = htons((uint16_t)atoi(port + 1));
        at = (const struct sockaddr *)&in;
        length = sizeof in;
    }
    for (int tries = 0; tries < 250; tries++, nanosleep(&pause, NULL)) {
        int s = socket(at->sa_family, SOCK_STREAM, 0);
        if (s >= 0 && !connect(s, at, length)) {
            if (!is_unix) setsockopt(s, IPPROTO_TCP, TCP_NODELAY, &one, sizeof one);
            return s;
        }
        fail_system("connecting to the run");
        if (s >= 0) close(s);
    }
    return -1;
}

int arlequin_serve(const char *address, struct arlequin_solver *s) {
    struct arlequin_link link = {.socket = -1};
    size_t dofs = s->nodes * (size_t)(s->components + s->rotations);
    double *work = malloc(8 * (dofs > s->memory ? dofs : s->memory));
    int kind, failed = 1;
    if (!address) address = getenv("ARLEQUIN_LINK");
    if (!address) arlequin_fail("no address: neither given nor in ARLEQUIN_LINK");
    else if (!work) arlequin_fail("no memory left");
    else link.socket = connect_to(address);
    if (link.socket >= 0 && (kind = receive(&link)) == HELLO) {
        current = &link;
        failed = describe(&link, s, work);
        while (!failed && kind != END) {
            if ((kind = receive(&link)) < 0) {
                failed = 1;
            } else if (arlequin_fail("no reason was given") && answer(&link, s, kind, work)) {
                failed = 1;
                if (!begin(&link, FAILED) && !put_text(&link.out, reason)) send_out(&link);
            } else {
                failed = send_out(&link);
            }
        }
        current = NULL;
    }
    if (link.socket >= 0) close(link.socket);
    free(link.out.bytes);
    free(link.in.bytes);
    free(work);
    return failed;
}
