# docker build -t stickbench --build-arg TORCH_INDEX=ADDRESS .    # address of PyTorch's CPU wheels
# docker run --rm -v "$PWD/demo:/stickbench/demo" stickbench
FROM python:3.11-slim
RUN apt-get update \
    && apt-get install -y --no-install-recommends \
        git make libx11-6 libegl1 libgl1 libgl1-mesa-dri \
    && rm -rf /var/lib/apt/lists/*
WORKDIR /stickbench
COPY . .
ARG TORCH_INDEX=
RUN make install PYTHON=python3.11 TORCH_INDEX="$TORCH_INDEX"
ENV PATH=/stickbench/.venv/bin:$PATH OMP_NUM_THREADS=1
ENTRYPOINT ["bench"]
CMD ["demo", "--force"]
