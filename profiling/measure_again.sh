#!/usr/bin/env bash
# Measure the committed results anew, each with its origin beside it, and write the tables from them.
#     profiling/measure_again.sh timings       # 2 cores with nothing else on them, about 35 minutes
#     profiling/measure_again.sh experiments   # one core, about 9 hours; accuracy only, so other work may run beside
#     profiling/measure_again.sh surfaces      # as many cores as there are; some 10 core hours, after dense-vs arms
#     profiling/measure_again.sh visp          # one core, about 6 minutes; needs ViSP (Debian: libvisp-dev)
#     profiling/measure_again.sh gpu           # one NVIDIA GPU, about 10 minutes
# Numbers after a command are minutes on one free core of a 2026 server.
set -euo pipefail
cd "$(dirname "$0")/.."
results=profiling/results
out=${OUT:-out/measured}
case "${1:-}" in
timings | experiments | surfaces | visp | gpu) ;;
*) sed -n '2,8s/^# *//p' "$0" >&2 && exit 2 ;;
esac
[ -z "$(git status --porcelain --untracked-files=no)" ] || { echo "commit first: results name the commit" >&2; exit 1; }
mkdir -p "$out"

measure() { python "profiling/$1.py" "${@:3}" --json "$out/$2.json"; }
reproduce() {
    local name
    name="$(echo "$*" | tr -d - | tr -s ' ' -)"
    OMP_NUM_THREADS=1 dense-vs reproduce "$@" --threads 1 --out "$out/$name" --json "$out/$name.json"
}

case "$1" in
timings)
    measure peers peers                         # 2
    measure peers peers_cold --calls 1          # 2
    measure frame_budget frame_budget --body    # 2
    measure reducers reducers                   # 1
    measure generative generative               # 3, needs PyTorch
    measure startup startup                     # 1
    measure scaling scaling_cpu --device cpu    # 1
    measure segmentation segmentation           # 10, needs the annotated images of VOS-VS (--data)
    measure tracking tracking                   # 12
    cp "$out"/{peers,peers_cold,frame_budget,reducers,generative,startup,scaling_cpu,segmentation,tracking}.json "$results"
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
        reproduce generative grasp --seed $seed                                           # 3
        reproduce generative grasp --independent 0.01 --seed $seed                        # 3
        reproduce generative insertion --seed $seed                                       # 12
        reproduce generative insertion --independent 0.002 --seed $seed                   # 12
    done
    for experiment in stages kfold single-camera camera-shift drift noisy-control relearning; do
        reproduce generative $experiment --seed 500 501                                   # 10 at most
    done
    reproduce generative noisy-states --seed 500 501 502 503 504 505                      # 3
    reproduce generative few-samples --seed $(seq -s ' ' 500 511)                         # 8
    reproduce generative few-samples --postures uniform --samples 10 15 20 50 --seed $(seq -s ' ' 500 511) # 6
    reproduce vosvs depth-log                                                             # 0, needs the recorded log
    reproduce generative speed --seed 500 501 502                                         # 3, nothing else running
    reproduce generative servo --seed 500 501                                             # 2
    python profiling/experiments.py "$out"/*-*.json
    ;;
surfaces)
    # A view that fails is a result too, so its exit code ends nothing.
    measure surfaces surfaces --jobs "$(nproc)" --seeds 0,1,2 || true
    measure surfaces surfaces_7 --jobs "$(nproc)" --joints 7 --seconds 20 --arms panda,ur5e,baxter,fetch || true
    measure surfaces surfaces_other_arms --jobs "$(nproc)" --arms spot-arm,tiago --no-exact || true
    cp "$out"/{surfaces,surfaces_7,surfaces_other_arms}.json "$results"
    ;;
visp)
    measure visp_peer ibvs_peer --out "$out/visp_peer"
    cp "$out/ibvs_peer.json" "$results"
    ;;
gpu)
    measure closed_loop closed_loop_h200 --device cuda:0 --randomize
    measure closed_loop closed_loop_h200_one --device cuda:0 --worlds 1 --speed-only
    measure closed_loop closed_loop_h200_order2 --device cuda:0 --randomize --order 2
    measure closed_loop closed_loop_h200_4096 --device cuda:0 --randomize --worlds 4096 --speed-only
    measure scaling scaling_h200 --device cuda:0
    measure roofline roofline_h200 --device cuda:0 --worlds 1,512
    measure batch_flow batch_flow_h200 --device cuda:0
    measure rendering rendering_h200 --device cuda:0 --randomize
    cp "$out"/{closed_loop_h200,closed_loop_h200_one,closed_loop_h200_order2,closed_loop_h200_4096,scaling_h200,roofline_h200,batch_flow_h200,rendering_h200}.json "$results"
    ;;
esac
python profiling/readme_table.py
python profiling/paper_pages.py
