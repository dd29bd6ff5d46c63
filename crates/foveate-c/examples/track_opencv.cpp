// Follows one target through a video that OpenCV opens:
//   ./track_opencv VIDEO LEFT TOP WIDTH HEIGHT
#include <opencv2/core.hpp>
#include <opencv2/videoio.hpp>

#include <cstdio>
#include <cstdlib>
#include <foveate.hpp>

int main(int argc, char **argv) try {
    if (argc != 6) {
        std::fprintf(stderr, "usage: %s VIDEO LEFT TOP WIDTH HEIGHT\n", argv[0]);
        return EXIT_FAILURE;
    }
    cv::VideoCapture video(argv[1]);
    if (!video.isOpened()) {
        std::fprintf(stderr, "%s: OpenCV cannot open the video\n", argv[1]);
        return EXIT_FAILURE;
    }
    cv::Rect box(std::atoi(argv[2]), std::atoi(argv[3]), std::atoi(argv[4]), std::atoi(argv[5]));
    cv::Mat image;
    foveate::CvTracker tracker; // in place of cv::TrackerCSRT::create()
    for (int frame = 0; video.read(image); frame++) {
        if (frame == 0) {
            tracker.init(image, box);
            continue;
        }
        const bool ok = tracker.update(image, box);
        std::printf("%d %d %d %d %d %s P(lost) %.2f\n", frame, box.x, box.y, box.width, box.height,
                    ok ? "ok" : "lost", tracker.result().p_lost);
    }
    return EXIT_SUCCESS;
} catch (const std::exception &error) {
    std::fprintf(stderr, "%s\n", error.what());
    return EXIT_FAILURE;
}
