/* Follows one target through raw RGB frames of standard input:
 *   ffmpeg -v error -i video.mp4 -f rawvideo -pix_fmt rgb24 - | ./track WIDTH HEIGHT LEFT TOP BOX_WIDTH BOX_HEIGHT */
#include <foveate.h>
#include <stdio.h>
#include <stdlib.h>

static void check(foveate_code code) {
    if (code != FOVEATE_CODE_OK) {
        fprintf(stderr, "%s\n", foveate_last_error());
        exit(EXIT_FAILURE);
    }
}

int main(int argc, char **argv) {
    if (argc != 7) {
        fprintf(stderr, "usage: %s WIDTH HEIGHT LEFT TOP BOX_WIDTH BOX_HEIGHT\n", argv[0]);
        return EXIT_FAILURE;
    }
    const int width = atoi(argv[1]), height = atoi(argv[2]);
    const foveate_box start = {atof(argv[3]), atof(argv[4]), atof(argv[5]), atof(argv[6])};
    const size_t stride = 3 * (size_t)width, size = stride * (size_t)height;
    uint8_t *pixels = malloc(size);
    const foveate_picture picture = {pixels, width, height, stride, FOVEATE_FORMAT_RGB};
    foveate_tracker *tracker = NULL;
    check(foveate_tracker_new("balanced", &tracker));
    for (int frame = 0; fread(pixels, 1, size, stdin) == size; frame++) {
        if (frame == 0) {
            check(foveate_tracker_init(tracker, &picture, start));
            continue;
        }
        foveate_result result;
        check(foveate_tracker_update(tracker, &picture, &result));
        const foveate_box box = result.bbox;
        printf("%d %.2f %.2f %.2f %.2f %s P(lost) %.2f\n", frame, box.x, box.y, box.width, box.height,
               result.usable ? "usable" : "guess", result.p_lost);
    }
    check(foveate_tracker_free(tracker));
    free(pixels);
    return EXIT_SUCCESS;
}
