#!/bin/sh
# The pictures of the report in read-the-report.md, from a checkout: sh docs/how-to/pictures/report.sh
set -e
here=$PWD/docs/how-to/pictures
work=$(mktemp -d)
cp sample_data/quickstart/*.csv "$work"
cd "$work"
shot() {  # name, folder, what is selected
    chromium --headless --no-sandbox --hide-scrollbars --virtual-time-budget=3000 \
        --window-size=1200,1720 --screenshot="$here/$1.png" "file://$work/$2/report.html#$3"
    python -c 'import sys; from PIL import Image; f = sys.argv[1]
Image.open(f).convert("RGB").quantize(255, dither=0).save(f, optimize=True)' "$here/$1.png"
}
tgospa-eval truth.csv estimate.csv -c 10 -g 5 --unit m -o result -q
shot swap result "step=37&truth=1"
tgospa-eval simulate normal --state gaussian --scenario parallel --targets 3 --steps 30 --noise 3 -q
tgospa-eval normal/truth.csv normal/estimate.csv --distance gaussian-wasserstein \
    -c 20 -g 5 -o ellipses -q
shot ellipses ellipses "step=15"
rm -r "$work"
