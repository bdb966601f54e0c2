#!/usr/bin/env bash
# Measure the committed results anew, each with its origin beside it, and write the tables from them.
#     profiling/measure_again.sh timings       # 2 cores with nothing else on them, about 40 minutes
#     profiling/measure_again.sh accuracy      # as many cores as there are, some hours; needs the humanoid's recordings
#     profiling/measure_again.sh experiments   # one core, about 9 hours; accuracy only, so other work may run beside
#     profiling/measure_again.sh surfaces      # cores and GPUs as the results name; some 10 core hours, after dense-vs arms
#     profiling/measure_again.sh live          # 2 cores with nothing else on them, over an hour
#     profiling/measure_again.sh visp          # one core, about 6 minutes; needs ViSP (Debian: libvisp-dev)
#     profiling/measure_again.sh gpu           # one NVIDIA GPU, about 10 minutes
#     profiling/measure_again.sh gpus          # four NVIDIA GPUs of one machine
# Arguments are those of the committed result (profiling/as_committed.py); runs of experiments have theirs below. Not
# here: mutation.json is written by make mutation, gpu_tests.txt by hand from the tests marked gpu.
# Numbers after a command are minutes on one free core of a 2026 server.
set -euo pipefail
cd "$(dirname "$0")/.."
results=profiling/results
out=${OUT:-out/measured}
case "${1:-}" in
timings | accuracy | experiments | surfaces | live | visp | gpu | gpus) ;;
*) sed -n '2,13s/^# *//p' "$0" >&2 && exit 2 ;;
esac
[ -z "$(git status --porcelain --untracked-files=no)" ] || { echo "commit first: results name the commit" >&2; exit 1; }
mkdir -p "$out"

# measure PROGRAM RESULT [OPTION ...]: as the result was measured, but for these options.
measured=()
measure() {
    rm -f "$out/$2.json"
    measured+=("$2")
    python profiling/as_committed.py "$1" "$2" "${@:3}" --json "$out/$2.json"
}
reproduce() {
    local name
    name="$(echo "$*" | tr -d - | tr -s ' ' -)"
    OMP_NUM_THREADS=1 dense-vs reproduce "$@" --threads 1 --out "$out/$name" --json "$out/$name.json"
}

case "$1" in
timings)
    measure peers peers                         # 2
    measure peers peers_cold                    # 2
    measure frame_budget frame_budget           # 2
    measure frame_budget frame_budget_panda     # 2, as the next three after dense-vs arms
    measure frame_budget frame_budget_panda_60  # 2
    measure frame_budget frame_budget_ur5e      # 2
    measure frame_budget frame_budget_ur5e_60   # 2
    measure reducers reducers                   # 1
    measure generative generative               # 3, needs PyTorch
    measure startup startup                     # 1
    measure sweep sweep                         # 4
    measure scaling scaling_cpu                 # 1
    measure segmentation segmentation           # 10, needs the annotated images of VOS-VS (--data)
    measure tracking tracking                   # 12
    measure body_model body_fit_time            # 7, after dense-vs arms
    ;;
accuracy)
    measure accuracy accuracy
    measure depth_row depth_row
    measure depth_row depth_row_realistic
    measure faults faults --jobs "$(nproc)"
    measure real_robot real_robot               # without the recordings it says so and writes nothing
    ;;
experiments)
    for seed in 501 502 503; do
        reproduce vosvs trial --jobs 4 --seed $seed                                       # 20 each
        reproduce vosvs trial --difficulty clean --seed $seed                             # 20 each
    done
    reproduce dije leak --seed 100 101 102 103 104                                        # 7
    reproduce dije labels --seed 100 101 102 103 104                                      # 4
    for experiment in reach rake vacuum; do
        for seed in 501 502 503; do
            reproduce dije $experiment --seed $seed                                       # 2 each
            reproduce dije $experiment --compliance --seed $seed                          # 2 each
        done
    done
    for seed in 501 502 503; do reproduce vosvs pick-place --seed $seed; done             # 12 each
    for seed in 501 502 503; do reproduce vosvs learn --responses 2 --seed $seed; done    # 10 each
    for seed in 501 502; do reproduce vosvs step-response --seed $seed; done              # 6 each
    reproduce vosvs track --seed 501                                                      # 3
    for experiment in track-person segmentations clutter collaboration; do
        for seed in 501 502 503; do reproduce vosvs $experiment --seed $seed; done        # 6 each
    done
    for seed in 501 502 503 504 505; do
        reproduce gothoskar grasp --seed $seed                                           # 3
        reproduce gothoskar grasp --independent 0.01 --seed $seed                        # 3
        reproduce gothoskar insertion --seed $seed                                       # 12
        reproduce gothoskar insertion --independent 0.002 --seed $seed                   # 12
    done
    for experiment in stages kfold single-camera camera-shift drift noisy-control relearning; do
        reproduce gothoskar $experiment --seed 500 501                                   # 10 at most
    done
    reproduce gothoskar noisy-states --seed 500 501 502 503 504 505                      # 3
    reproduce gothoskar few-samples --seed $(seq -s ' ' 500 511)                         # 8
    reproduce gothoskar few-samples --postures uniform --samples 10 15 20 50 --seed $(seq -s ' ' 500 511) # 6
    reproduce vosvs depth-log                                                             # 0, needs the recorded log
    reproduce gothoskar speed --seed 500 501 502                                         # 3, nothing else running
    reproduce gothoskar servo --seed 500 501                                             # 2
    python profiling/experiments.py "$out"/*-*.json
    ;;
surfaces)
    # A view that fails is a result too, so its exit code ends nothing.
    measure surfaces surfaces --jobs "$(nproc)" || true
    measure surfaces surfaces_7 --jobs "$(nproc)" || true
    measure surfaces surfaces_other_arms --jobs "$(nproc)" || true
    measure surfaces surfaces_other_cameras --jobs "$(nproc)" || true
    measure hidden_points hidden_points --jobs "$(nproc)"
    measure body_model body_model --jobs "$(nproc)"
    measure body_changes body_changes --jobs "$(nproc)"
    ;;
live)
    measure live live                           # 2
    measure live_growth live_growth             # 60
    ;;
visp)
    measure visp_peer ibvs_peer --out "$out/visp_peer"
    ;;
gpu)
    measure closed_loop closed_loop_h200
    measure closed_loop closed_loop_h200_one
    measure closed_loop closed_loop_h200_order2
    measure closed_loop closed_loop_h200_4096
    measure scaling scaling_h200
    measure roofline roofline_h200
    measure batch_flow batch_flow_h200
    measure rendering rendering_h200
    ;;
gpus)
    measure closed_loop closed_loop_h200_gpus
    ;;
esac
for name in ${measured[@]+"${measured[@]}"}; do
    if [ -f "$out/$name.json" ]; then cp "$out/$name.json" "$results"; else echo "$name: nothing was written, left as it was" >&2; fi
done
python profiling/faults.py --page
python profiling/readme_table.py
python profiling/paper_pages.py
