// As boxes.c, with foveate.hpp.
#include <cinttypes>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <foveate.hpp>
#include <fstream>
#include <utility>

static void print(int frame, const foveate::Result &result) {
    std::printf("%d %" PRIu64 " %d %d %" PRId64, frame, result.id, static_cast<int>(result.status), result.usable,
                result.detection);
    const auto bits = [](double value) {
        std::uint64_t word;
        std::memcpy(&word, &value, sizeof word);
        std::printf(" %" PRIx64, word);
    };
    for (double value : {result.bbox.x, result.bbox.y, result.bbox.width, result.bbox.height, result.p_lost}) bits(value);
    for (const auto &row : result.covariance)
        for (double value : row) bits(value);
    std::printf("\n");
}

int main(int argc, char **argv) try {
    const auto number = [&](int i) { return i < argc ? std::atoi(argv[i]) : 0; };
    std::vector<std::uint8_t> pixels(static_cast<std::size_t>(number(6)) * static_cast<std::size_t>(number(5)));
    const foveate::Picture picture = {pixels.data(), number(4), number(5), static_cast<std::size_t>(number(6)), number(7)};
    std::vector<foveate::Box> boxes;
    for (int i = 9; i + 3 < argc; i += 4)
        boxes.push_back({double(number(i)), double(number(i + 1)), double(number(i + 2)), double(number(i + 3))});
    std::ifstream file(argv[3], std::ios::binary);
    const auto read = [&] {
        return bool(file.read(reinterpret_cast<char *>(pixels.data()), static_cast<std::streamsize>(pixels.size())));
    };
    if (std::strcmp(argv[1], "single") == 0) {
        foveate::Tracker tracker(argv[2]);
        for (int frame = 0; read(); frame++) {
            if (frame == 0) {
                tracker.init(picture, boxes.at(0));
                continue;
            }
            tracker.set_time(frame / 25.0); // At a constant rate times change nothing.
            const foveate::Result result = tracker.update(picture);
            print(frame, result);
            if (tracker.predict(1.5).p_lost != result.p_lost) throw std::runtime_error("a prediction has another P(lost)");
            if (frame == number(8)) {
                foveate::Tracker other(argv[2]);
                other.skip(picture);
                other.load(tracker.save());
                tracker = std::move(other);
            }
        }
        return EXIT_SUCCESS;
    }
    foveate::MultiTracker tracker(argv[2]);
    for (int frame = 0; read(); frame++) {
        std::vector<foveate::Detection> detections;
        for (const foveate::Box &box : boxes)
            if (frame > 0) detections.push_back({{box.x + frame, box.y, box.width, box.height}, 0.9});
        tracker.update(picture, detections);
        for (const foveate::Box &box : boxes)
            if (frame == 0) tracker.add(picture, box);
        for (const foveate::Result &result : tracker.targets()) print(frame, result);
        if (frame == number(8)) {
            foveate::MultiTracker other(argv[2]);
            other.load(tracker.save());
            other.skip(picture);
            tracker = std::move(other);
        }
    }
    return EXIT_SUCCESS;
} catch (const foveate::Error &error) {
    std::fprintf(stderr, "code %d: %s\n", static_cast<int>(error.code()), error.what());
    return EXIT_FAILURE;
}
