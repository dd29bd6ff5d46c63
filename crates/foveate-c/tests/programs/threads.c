/* Two threads use one handle: their calls run one after the other, also with a call that frees it. */
#include <foveate.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define CALLS 20

static uint8_t pixels[120 * 90];
static const foveate_picture picture = {pixels, 120, 90, 120, FOVEATE_FORMAT_GREY};
static foveate_tracker *tracker = NULL;

static void check(foveate_code code) {
    if (code != FOVEATE_CODE_OK) {
        fprintf(stderr, "code %d: %s\n", (int)code, foveate_last_error());
        exit(EXIT_FAILURE);
    }
}

static void *updates(void *unused) {
    foveate_result result;
    for (int i = 0; i < CALLS; i++) check(foveate_tracker_update(tracker, &picture, &result));
    return unused;
}

static void *until_freed(void *unused) {
    foveate_result result;
    foveate_code code = FOVEATE_CODE_OK;
    while (code == FOVEATE_CODE_OK) code = foveate_tracker_update(tracker, &picture, &result);
    if (code != FOVEATE_CODE_HANDLE || !strstr(foveate_last_error(), "freed")) exit(EXIT_FAILURE);
    return unused;
}

static void in_two_threads(void *(*act)(void *), int frees) {
    pthread_t threads[2];
    for (int i = 0; i < 2; i++)
        if (pthread_create(&threads[i], NULL, act, NULL) != 0) exit(EXIT_FAILURE);
    if (frees) check(foveate_tracker_free(tracker));
    for (int i = 0; i < 2; i++) pthread_join(threads[i], NULL);
}

int main(void) {
    for (size_t i = 0; i < sizeof pixels; i++) pixels[i] = (uint8_t)(i * i / 7);
    const foveate_box box = {40, 30, 24, 20};
    foveate_tracker *alone = NULL;
    foveate_result expected, found;
    check(foveate_tracker_new("fast", &tracker));
    check(foveate_tracker_new("fast", &alone));
    check(foveate_tracker_init(tracker, &picture, box));
    check(foveate_tracker_init(alone, &picture, box));
    in_two_threads(updates, 0);
    for (int i = 0; i < 2 * CALLS; i++) check(foveate_tracker_update(alone, &picture, &expected));
    check(foveate_tracker_update(alone, &picture, &expected));
    check(foveate_tracker_update(tracker, &picture, &found));
    if (memcmp(&found.bbox, &expected.bbox, sizeof found.bbox) != 0 || memcmp(&found.p_lost, &expected.p_lost, sizeof found.p_lost) != 0)
        return EXIT_FAILURE;
    check(foveate_tracker_free(alone));
    in_two_threads(until_freed, 1);
    return EXIT_SUCCESS;
}
