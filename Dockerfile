# The node graph and the operator's page, for amd64 and arm64: docs/install.md.

FROM ros:jazzy-ros-base AS build
RUN apt-get update \
    && apt-get install --yes --no-install-recommends python3-pip \
    && rm -rf /var/lib/apt/lists/*
WORKDIR /built
# Ubuntu's packages by the keys of package.xml. They are only listed here: rosdep itself and the
# compilers of this image are not needed in the other. Left out are OpenCV, of which pip has a smaller
# one (Debian's takes 0.7 GB, with Qt, VTK and MPI), and what only plots need (0.8 GB).
COPY package.xml /src/
RUN rosdep update --rosdistro jazzy \
    && rosdep keys --from-paths /src --ignore-src --rosdistro jazzy --dependency-types exec > keys \
    && grep --invert-match 'opencv\|matplotlib\|scipy' keys \
        | xargs rosdep resolve --rosdistro jazzy > resolved \
    && sed '/^#/d' resolved > packages
COPY . /src
RUN pip wheel --no-cache-dir --no-deps --wheel-dir . /src

FROM ros:jazzy-ros-core
# The typeface is for labels. The messages of this ROS are compiled against NumPy 1, and so is OpenCV
# to 4.11.
RUN --mount=type=bind,from=build,source=/built,target=/built \
    apt-get update \
    && xargs apt-get install --yes --no-install-recommends python3-pip fonts-dejavu-core < /built/packages \
    && rm -rf /var/lib/apt/lists/* \
    && pip install --break-system-packages --no-cache-dir 'numpy<2' 'opencv-python-headless<4.12' \
        mcap pyogrio av mgrs pytak \
    && pip install --break-system-packages --no-cache-dir --no-deps /built/*.whl
# Where pip has put the wheel; the base's entry point adds ROS to it.
ENV AMENT_PREFIX_PATH=/usr/local
# Targets, recordings and ROS's log are written to the home, and nothing elsewhere.
ENV HOME=/var/lib/tirgeo
RUN usermod --append --groups dialout ubuntu && install --directory --owner ubuntu "$HOME"
WORKDIR /var/lib/tirgeo
# User 1000: nodes meet in shared memory only where they run as the same user.
USER ubuntu
# As Ctrl-C: the nodes end in order, recordings are completed.
STOPSIGNAL SIGINT
CMD ["tirgeo", "run", "--params", "/etc/tirgeo/aircraft.yaml", "--map", "/etc/tirgeo/map.gpkg", "--page", "0.0.0.0:8080"]
