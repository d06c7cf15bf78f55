/* The order in which unknowns are eliminated, by approximate minimum degree (Amestoy, Davis and
   Duff 1996).

   The quotient graph begins as the finite elements themselves: two unknowns are neighbours if an
   element joins them. An eliminated unknown leaves a new element, which joins what it was joined
   with and absorbs the elements that it belonged to. Unknowns with the same elements are one. */

#include <stdlib.h>
#include <string.h>

#include "fronts.h"

typedef struct {
    int unknowns, elements, fronts;
    int *weight;  /* of unknowns: how many are merged in it; 0: merged or eliminated */
    int *next_alike, *last_alike;
    int *joined_at, *joined_count, *joined;  /* elements of each unknown */
    int **members, *member_count, *size;     /* unknowns of each element, and their weight */
    int *outside, *outside_stamp;            /* weight of an element outside of the new one */
    int *stamp_of, stamp;
    int *bucket, *bucket_next;               /* unknowns by a hash of their elements */
    int *by_degree, *next, *previous, *degree, least;
    const Order *found;
} Graph;

static void take_out(Graph *g, int v) {
    int before = g->previous[v], after = g->next[v];
    if (before >= 0) g->next[before] = after;
    else g->by_degree[g->degree[v]] = after;
    if (after >= 0) g->previous[after] = before;
}

static void put_in(Graph *g, int v, int degree) {
    int after = g->by_degree[degree];
    g->degree[v] = degree;
    g->previous[v] = -1;
    g->next[v] = after;
    if (after >= 0) g->previous[after] = v;
    g->by_degree[degree] = v;
    if (degree < g->least) g->least = degree;
}

static void eliminated_with(Graph *g, int v, int front) {
    for (int one = v; one >= 0; one = g->next_alike[one]) g->found->of_unknown[one] = front;
    g->weight[v] = 0;
}

static void absorb(Graph *g, int element, int front) {
    if (element < g->elements) g->found->of_element[element] = front;
    else g->found->parent[element - g->elements] = front;
    free(g->members[element]);
    g->members[element] = NULL;
}

static int same_elements(Graph *g, int u, int v) {
    int count = g->joined_count[u], *of_u = g->joined + g->joined_at[u],
        *of_v = g->joined + g->joined_at[v];
    if (count != g->joined_count[v]) return 0;
    g->stamp++;
    for (int k = 0; k < count; k++) g->stamp_of[of_u[k]] = g->stamp;
    for (int k = 0; k < count; k++)
        if (g->stamp_of[of_v[k]] != g->stamp) return 0;
    return 1;
}

/* Merge unknowns of a list that have the same elements, and return how many are left. */
static int merge_alike(Graph *g, int *list, int count) {
    int kept = 0;
    for (int k = 0; k < count; k++) {
        int v = list[k], u;
        unsigned hash = 0;
        for (int e = 0; e < g->joined_count[v]; e++)
            hash += (unsigned)g->joined[g->joined_at[v] + e] * 2654435761u;
        int place = (int)(hash % (unsigned)g->unknowns);
        for (u = g->bucket[place]; u >= 0; u = g->bucket_next[u])
            if (same_elements(g, u, v)) break;
        if (u >= 0) {
            g->weight[u] += g->weight[v];
            g->weight[v] = 0;
            g->next_alike[g->last_alike[u]] = v;
            g->last_alike[u] = g->last_alike[v];
            continue;
        }
        g->bucket_next[v] = g->bucket[place];
        g->bucket[place] = v;
        g->degree[v] = place;  /* until it is put in again */
        list[kept++] = v;
    }
    for (int k = 0; k < kept; k++) g->bucket[g->degree[list[k]]] = -1;
    return kept;
}

/* Join the elements of the unknown p in one, which becomes the front. 0: no memory. */
static int eliminate(Graph *g, int p, int front, int *left) {
    int element = g->elements + front, bound = 0, count = 0, size = 0;
    int *mine = g->joined + g->joined_at[p], *border;
    for (int k = 0; k < g->joined_count[p]; k++) bound += g->member_count[mine[k]];
    border = malloc(sizeof(int) * (size_t)(bound + 1));
    if (!border) return 0;
    *left -= g->weight[p];
    eliminated_with(g, p, front);
    for (int k = 0; k < g->joined_count[p]; k++) {
        int e = mine[k];
        for (int i = 0; i < g->member_count[e]; i++) {
            int v = g->members[e][i];
            if (g->weight[v] <= 0) continue;
            border[count++] = v;
            size += g->weight[v];
            g->weight[v] = -g->weight[v];  /* it is in the border */
            take_out(g, v);
        }
        absorb(g, e, front);
    }
    g->stamp++;
    for (int k = 0; k < count; k++) {
        int v = border[k], *joined = g->joined + g->joined_at[v];
        g->weight[v] = -g->weight[v];
        for (int i = 0; i < g->joined_count[v]; i++) {
            int e = joined[i];
            if (!g->members[e]) continue;
            if (g->outside_stamp[e] != g->stamp) {
                g->outside_stamp[e] = g->stamp;
                g->outside[e] = g->size[e];
            }
            g->outside[e] -= g->weight[v];
        }
    }
    int kept = 0;
    for (int k = 0; k < count; k++) {
        int v = border[k], *joined = g->joined + g->joined_at[v], some = 0, beyond = 0;
        for (int i = 0; i < g->joined_count[v]; i++) {
            int e = joined[i];
            if (!g->members[e]) continue;
            if (!g->outside[e]) {
                absorb(g, e, front);
                continue;
            }
            joined[some++] = e;
            beyond += g->outside[e];
        }
        if (!some) {  /* nothing else holds it */
            size -= g->weight[v];
            *left -= g->weight[v];
            eliminated_with(g, v, front);
            continue;
        }
        joined[some++] = element;
        g->joined_count[v] = some;
        g->next[v] = beyond;
        border[kept++] = v;
    }
    count = merge_alike(g, border, kept);
    for (int k = 0; k < count; k++) {
        int v = border[k], most = *left - g->weight[v], degree = g->next[v] + size - g->weight[v];
        put_in(g, v, degree < most ? degree : most);
    }
    g->members[element] = border;
    g->member_count[element] = count;
    g->size[element] = size;
    g->found->border[front] = size;
    g->found->parent[front] = -1;
    return 1;
}

static int degree_at_first(Graph *g, int v) {
    int degree = 0;
    g->stamp++;
    g->stamp_of[g->elements + v] = g->stamp;
    for (int k = 0; k < g->joined_count[v]; k++) {
        int e = g->joined[g->joined_at[v] + k];
        for (int i = 0; i < g->member_count[e]; i++) {
            int u = g->members[e][i];
            if (g->stamp_of[g->elements + u] == g->stamp) continue;
            g->stamp_of[g->elements + u] = g->stamp;
            degree += g->weight[u] > 0 ? g->weight[u] : 0;
        }
    }
    return degree;
}

static int begin(Graph *g, Joined joined) {
    const int *start = joined.start, *unknown = joined.unknown;
    int n = g->unknowns, m = g->elements;
    for (int e = 0; e < m; e++) {
        int count = start[e + 1] - start[e];
        g->members[e] = malloc(sizeof(int) * (size_t)(count + 1));
        if (!g->members[e]) return 0;
        memcpy(g->members[e], unknown + start[e], sizeof(int) * (size_t)count);
        g->member_count[e] = g->size[e] = count;
        for (int k = start[e]; k < start[e + 1]; k++) g->joined_count[unknown[k]]++;
    }
    for (int v = 0, at = 0; v < n; v++) {
        g->joined_at[v] = at;
        at += g->joined_count[v];
        g->joined_count[v] = 0;
        g->weight[v] = 1;
        g->next_alike[v] = -1;
        g->last_alike[v] = v;
        g->bucket[v] = g->by_degree[v] = -1;
    }
    g->by_degree[n] = -1;
    for (int e = 0; e < m; e++)
        for (int k = start[e]; k < start[e + 1]; k++) {
            int v = unknown[k];
            g->joined[g->joined_at[v] + g->joined_count[v]++] = e;
        }
    return 1;
}

/* 0: no memory. */
int minimum_degree(Joined joined, Order *found) {
    int unknowns = joined.unknowns, elements = joined.elements;
    Graph g = {.unknowns = unknowns, .elements = elements, .found = found, .least = unknowns};
    size_t n = (size_t)unknowns, m = (size_t)elements, total = (size_t)joined.start[elements];
    size_t of_unknown = n + 1, of_both = n + m + 1;
    int *room = calloc(11 * of_unknown + 4 * of_both + (total + 1), sizeof(int)), *at = room;
    int *list = malloc(sizeof(int) * of_unknown);
    int ok = 0, count = unknowns, left = unknowns;
    g.members = calloc(of_both, sizeof(int *));
    if (!room || !list || !g.members) goto end;
    int **by_unknown[] = {&g.weight, &g.next_alike, &g.last_alike, &g.joined_at, &g.joined_count,
                          &g.bucket, &g.bucket_next, &g.by_degree, &g.next, &g.previous, &g.degree};
    int **by_both[] = {&g.member_count, &g.size, &g.outside, &g.outside_stamp};
    for (int k = 0; k < 11; k++, at += of_unknown) *by_unknown[k] = at;
    for (int k = 0; k < 4; k++, at += of_both) *by_both[k] = at;
    g.joined = at;
    g.stamp_of = calloc(of_both, sizeof(int));
    if (!g.stamp_of || !begin(&g, joined)) goto end;
    for (int v = 0; v < unknowns; v++) list[v] = v;
    count = merge_alike(&g, list, count);
    for (int k = 0; k < count; k++) {
        int v = list[k];
        put_in(&g, v, degree_at_first(&g, v));
    }
    while (left > 0) {
        while (g.by_degree[g.least] < 0) g.least++;
        int p = g.by_degree[g.least];
        take_out(&g, p);
        if (!eliminate(&g, p, g.fronts++, &left)) goto end;
    }
    found->fronts = g.fronts;
    ok = 1;
end:
    if (g.members)
        for (size_t e = 0; e < of_both; e++) free(g.members[e]);
    free(g.members);
    free(g.stamp_of);
    free(list);
    free(room);
    return ok;
}
