/* Prints the resident memory in kB after 200 and after 2,000 updates of a tracker of one target and of one of many.
 * flat FILE WIDTH HEIGHT FRAMES LEFT TOP WIDTH HEIGHT */
#include <foveate.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static void check(foveate_code code) {
    if (code != FOVEATE_CODE_OK) {
        fprintf(stderr, "code %d: %s\n", (int)code, foveate_last_error());
        exit(EXIT_FAILURE);
    }
}

static void print_memory(void) {
    FILE *status = fopen("/proc/self/status", "r");
    char line[256];
    while (status && fgets(line, sizeof line, status))
        if (strncmp(line, "VmRSS:", 6) == 0) printf("%ld\n", strtol(line + 6, NULL, 10));
    if (status) fclose(status);
}

int main(int argc, char **argv) {
    if (argc != 9) return EXIT_FAILURE;
    const int width = atoi(argv[2]), height = atoi(argv[3]), frames = atoi(argv[4]);
    const foveate_box box = {atof(argv[5]), atof(argv[6]), atof(argv[7]), atof(argv[8])};
    const size_t bytes = 3 * (size_t)width * (size_t)height;
    uint8_t *video = malloc(bytes * (size_t)frames);
    FILE *file = fopen(argv[1], "rb");
    if (!file || fread(video, bytes, (size_t)frames, file) != (size_t)frames) return EXIT_FAILURE;
    fclose(file);
    foveate_picture picture = {video, width, height, 3 * (size_t)width, FOVEATE_FORMAT_RGB};
    foveate_tracker *tracker = NULL;
    foveate_multi *multi = NULL;
    size_t targets = 0;
    uint64_t id = 0;
    check(foveate_tracker_new("fast", &tracker));
    check(foveate_multi_new("multi-boxes", &multi));
    check(foveate_tracker_init(tracker, &picture, box));
    check(foveate_multi_update(multi, &picture, NULL, 0, &targets));
    check(foveate_multi_add(multi, &picture, box, &id));
    for (int i = 1; i <= 2000; i++) {
        const int round = i % (2 * frames - 2); /* to the end and back */
        picture.pixels = video + bytes * (size_t)(round < frames ? round : 2 * frames - 2 - round);
        foveate_result result;
        check(foveate_tracker_update(tracker, &picture, &result));
        check(foveate_multi_update(multi, &picture, NULL, 0, &targets));
        if (i == 200 || i == 2000) print_memory();
    }
    check(foveate_tracker_free(tracker));
    check(foveate_multi_free(multi));
    free(video);
    return EXIT_SUCCESS;
}
